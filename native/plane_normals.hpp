// Normals of a depth image, by planes fitted to windows of it.
#pragma once

namespace goc {

struct DepthImage {
  const float* depth;  // z (height, width), NaN = none
  int width, height;
  float fx, fy, cx, cy;
};

// Unit normals (height, width, 3), camera axes, facing the camera; NaN where fewer than `fewest` pixels of the window
// (2·radius + 1)² lie within the share `agree` of the middle's depth, or where they lie on one line.
void plane_normals(const DepthImage& image, int radius, float agree, int fewest, float* normals);

}  // namespace goc
