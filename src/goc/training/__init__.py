"""Learns the weights that `goc.complete` loads (paper §5.1 to 5.3): shapes, masks, losses, the loop."""
