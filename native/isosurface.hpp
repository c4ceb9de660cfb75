// Marching cubes (Lorensen and Cline 1987) over sparse voxel blocks, one shared vertex a crossed edge: no seams, and a
// manifold: no edge is on more than two faces.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace goc {

struct Isosurface {
  // Voxels (block * 512 + offset) at the two ends of the lattice edge that each vertex lies on; lower end first.
  std::vector<std::int64_t> edges;  // (v, 2)
  std::vector<std::int32_t> faces;  // (t, 3), counter-clockwise seen from the positive side
};

// Zero level of `values` (count, 8, 8, 8), positive outside; cells with a NaN corner, or a corner in no block, are left
// open. `blocks` (count, 3) are distinct block coordinates.
Isosurface isosurface(const std::int32_t* blocks, std::size_t count, const float* values);

}  // namespace goc
