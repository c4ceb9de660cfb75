"""Makes captures with complete ground truth: furnished rooms, cameras, ray-cast images."""
