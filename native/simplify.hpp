// A closed mesh with fewer and rounder faces: edge collapses ordered by quadrics (Garland and Heckbert 1997), flips and
// small moves, none of which takes the original's vertices or the middles of its faces further from it than a tolerance.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace goc {

struct SimplifyLimits {
  double tolerance;       // greatest distance of these points from the new surface
  std::size_t faces;      // collapses that are not for shape end here
  double quality;         // wanted of every face: 4 sqrt(3) area / sum of squared edges, 1 for equilateral ones
  double value;         // length that a unit of difference between values counts as: there, vertices are merged late
};

struct Surface {
  std::vector<float> vertices;       // (v, 3)
  std::vector<std::int32_t> faces;   // (t, 3)
  std::vector<float> values;         // (v, 3), means over what was merged
  std::vector<std::uint8_t> groups;  // (v)
};

// The surface must be closed and manifold (every edge on exactly two faces, run along in opposite directions) and is
// returned so. Vertices of different groups are never merged, and the line between groups counts as a sharp edge.
Surface simplify(Surface mesh, const SimplifyLimits& limits);

}  // namespace goc
