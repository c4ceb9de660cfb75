// Which cells of space the pixels of a depth image fall into, by id.
#pragma once
#include <cstdint>
#include <vector>

#include "fuse.hpp"

namespace goc {

// Distinct keys in ascending order, with their numbers of pixels. A key is 16 bits each of id, x, y and z of the cell
// (edge `cell`, lower corner of cell 0 at the origin), each biased by 32768; pixels beyond that range are left out, and
// those without a slope.
void count_cells(const DepthView& view, double cell, std::vector<std::uint64_t>& keys, std::vector<std::int64_t>& hits);

}  // namespace goc
