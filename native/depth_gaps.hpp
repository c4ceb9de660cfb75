// How far behind points a view's depth lies: what src/goc/extract/agreement.py compares views by.
#pragma once
#include <cstddef>

#include "camera.hpp"

namespace goc {

// points: world, NaN allowed. depth: z of the camera's pixels, NaN = none. one_surface: four pixels whose depths differ by
// a smaller share are one surface. between: gap to the surface between the four pixels round each point's, NaN where they
// are none; nearest: that, or else the smallest gap to any of the four. Both NaN where the point is not seen.
void depth_gaps(const float* points, std::size_t count, const Camera& camera, const float* depth, float one_surface,
                float* between, float* nearest);

}  // namespace goc
