"""Gaps between points and a view's depth, as plain tensor arithmetic."""

import torch


def depth_gaps(points, camera, depth, one_surface):
    pixels, z = camera.project(points)
    place = pixels - 0.5
    corner = place.nan_to_num(-1.0).floor()
    inside = (corner >= 0).all(-1) & (corner[..., 0] < camera.width - 1) & (corner[..., 1] < camera.height - 1)
    x, y = torch.where(inside[..., None], corner, 0.0).long().unbind(-1)
    first, flat = y * camera.width + x, depth.reshape(-1)
    four = torch.stack([flat[first + step] for step in (0, 1, camera.width, camera.width + 1)], -1)
    share_x, share_y = (place - corner).unbind(-1)
    weights = [(1 - share_x) * (1 - share_y), share_x * (1 - share_y), (1 - share_x) * share_y, share_x * share_y]
    smooth = 1.0 / (torch.stack(weights, -1) / four).sum(-1)  # planes are linear in 1/z
    single = four.amax(-1) - four.amin(-1) < one_surface * smooth  # NaN is no surface
    between = torch.where(inside & single, smooth - z, torch.nan)
    each = torch.where(inside[..., None], four - z[..., None], torch.nan)
    nearest = torch.where(each.isnan(), torch.inf, each.abs()).min(-1, keepdim=True).indices
    return between, torch.where(between.isnan(), each.gather(-1, nearest)[..., 0], between)
