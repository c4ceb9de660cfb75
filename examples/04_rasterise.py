"""Draw splats, and differentiate through the drawing: any channels, a value for each splat.

    python examples/04_rasterise.py [FOLDER]

A wall of splats learns the colours of a picture by gradient descent. FOLDER (default: out/example) gets wall.png.
Seconds.
"""

import sys
from pathlib import Path

import torch

from goc.files import write_image
from goc.raster import rasterize
from goc.scene import Camera, Gaussians

SIDE = 64


def wall(across: int) -> Gaussians:
    """Flat, round splats on a square of 2 m, 2 m before the camera."""
    at = torch.linspace(-1.0, 1.0, across)
    x, y = torch.meshgrid(at, at, indexing="xy")
    count, width = across * across, 1.0 / across
    return Gaussians(
        means=torch.stack([x.reshape(-1), y.reshape(-1), torch.full((count,), 2.0)], 1),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        log_scales=torch.tensor([width, width, 1e-3]).log().repeat(count, 1),
        opacity_logits=torch.full((count,), 2.0),
        sh=torch.zeros(count, 1, 3),
    )


def picture() -> torch.Tensor:
    """A disc on a gradient, (h w 3) in [0, 1]."""
    at = torch.linspace(-1.0, 1.0, SIDE)
    x, y = torch.meshgrid(at, at, indexing="xy")
    disc = (x.square() + y.square() < 0.3).float()
    return torch.stack([0.5 + 0.5 * x, 0.5 + 0.5 * y, disc], -1)


def main(folder: Path) -> None:
    """Fit the colours of the splats to the picture."""
    camera = Camera(
        focal_px=torch.tensor([SIDE, SIDE], dtype=torch.float32),
        centre_px=torch.tensor([SIDE / 2, SIDE / 2]),
        width=SIDE,
        height=SIDE,
        world_from_cam=torch.eye(4),
    )
    splats, target = wall(across=32), picture()
    colours = torch.full((len(splats), 3), 0.5, requires_grad=True)
    optimiser = torch.optim.Adam([colours], lr=0.05)
    losses = []
    for _ in range(60):
        image, _ = rasterize(splats, camera, colours)  # (h w 3), and alpha (h w)
        loss = (image - target).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())

    # Depth is one more choice of channels: z of the splats, blended, over alpha.
    depth, alpha = rasterize(splats, camera, splats.means[:, 2:])
    print(f"loss {losses[0]:.4f} -> {losses[-1]:.4f}")
    print(f"depth in the middle: {(depth[..., 0] / alpha)[SIDE // 2, SIDE // 2]:.3f} m")
    write_image(folder / "wall.png", (image.detach().clamp(0, 1) * 255).round().byte().numpy())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
