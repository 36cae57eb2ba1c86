"""Frames -> frames retouched by a video diffusion model: soft shadows and reflections, with the objects as they were."""
