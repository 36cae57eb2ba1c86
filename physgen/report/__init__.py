"""Write frames and results into files: the video, the run record, the page."""
