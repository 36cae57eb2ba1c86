"""Photo -> proposals of whole objects -> the subset that explains the photo best, without training."""
