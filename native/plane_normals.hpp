// Normals of a depth image, by planes fitted to windows of it.
#pragma once
#include "camera.hpp"

namespace goc {

// Unit normals (height, width, 3) of z-depth (height, width; NaN = none), camera axes, facing the camera; NaN where fewer than `fewest` pixels of the window
// (2·radius + 1)² lie within the share `agree` of the middle's depth, or where they lie on one line.
void plane_normals(const float* depth, const Lens& lens, int radius, float agree, int fewest, float* normals);

}  // namespace goc
