#include "isosurface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "threads.hpp"

namespace goc {
namespace {

constexpr int kEdge = 8, kVoxels = 512, kHalo = kEdge + 1;

// Corner c of a cell sits at (c & 1, c >> 1 & 1, c >> 2) along (x, y, z); its edges are 3 * lower corner + axis.
// Triangles of each of the 256 sign patterns, as such edges.
using Patterns = std::array<std::vector<std::array<std::uint8_t, 3>>, 256>;

int edge_between(int a, int b) {
  const int low = a & b, bit = a ^ b;
  return 3 * low + (bit == 1 ? 0 : bit == 2 ? 1 : 2);
}

// The contour across each face of the cell, from a crossed edge to the next, with the inside on its right seen from
// outside the cell. Two opposite inside corners of a face stay apart: a rule of the face alone, so that neighbours agree.
std::array<int, 24> contour(int inside) {
  static constexpr int kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  std::array<int, 24> next;
  next.fill(-1);
  for (const auto& face : kFaces) {
    for (int c = 0; c < 4; ++c) {  // entering the inside along the face's rim at c: leave it where it ends
      const int a = face[c], b = face[(c + 1) % 4];
      if ((inside >> a & 1) || !(inside >> b & 1)) continue;
      int last = (c + 1) % 4;
      while (inside >> face[(last + 1) % 4] & 1) last = (last + 1) % 4;
      next[edge_between(face[last], face[(last + 1) % 4])] = edge_between(a, b);
    }
  }
  return next;
}

bool on_one_face(int edge, int other) {
  const auto faces = [](int e) {  // the two faces of the cell that meet in the edge, as bits: 2 * axis + side
    const int axis = e % 3, corner = e / 3, u = (axis + 1) % 3, v = (axis + 2) % 3;
    return 1 << (2 * u + (corner >> u & 1)) | 1 << (2 * v + (corner >> v & 1));
  };
  return faces(edge) & faces(other);
}

// Where a loop's fan of triangles starts. A diagonal within a face of the cell could be the neighbour's diagonal too, and
// then four triangles would share it; every loop has a start without such diagonals, so the surface is a manifold.
std::size_t fan_start(const std::vector<std::uint8_t>& loop) {
  for (std::size_t start = 0; start < loop.size(); ++start) {
    bool good = true;
    for (std::size_t i = 2; i + 1 < loop.size(); ++i)
      good &= !on_one_face(loop[start], loop[(start + i) % loop.size()]);
    if (good) return start;
  }
  return 0;
}

Patterns make_patterns() {
  Patterns patterns;
  for (int inside = 1; inside < 255; ++inside) {
    std::array<int, 24> next = contour(inside);
    for (int start = 0; start < 24; ++start) {
      std::vector<std::uint8_t> loop;
      for (int edge = start; next[edge] >= 0;) {
        loop.push_back(static_cast<std::uint8_t>(edge));
        const int follow = next[edge];
        next[edge] = -1;
        edge = follow;
      }
      if (loop.empty()) continue;
      std::rotate(loop.begin(), loop.begin() + static_cast<std::ptrdiff_t>(fan_start(loop)), loop.end());
      for (std::size_t i = 2; i < loop.size(); ++i) patterns[inside].push_back({loop[0], loop[i], loop[i - 1]});
    }
  }
  return patterns;
}

const Patterns& patterns() {
  static const Patterns table = make_patterns();
  return table;
}

std::uint64_t key(std::int32_t x, std::int32_t y, std::int32_t z) {
  constexpr std::uint64_t bias = 1u << 20, mask = (1u << 21) - 1;
  return ((x + bias) & mask) << 42 | ((y + bias) & mask) << 21 | ((z + bias) & mask);
}

// A block's voxels and one layer of its upper neighbours: index of each in the volume, -1 where there is no block.
class Halo {
 public:
  Halo(const std::int32_t* blocks, std::size_t count) : blocks_(blocks) {
    index_.reserve(count * 2);
    for (std::size_t b = 0; b < count; ++b)
      index_.emplace(key(blocks[3 * b], blocks[3 * b + 1], blocks[3 * b + 2]), static_cast<std::int64_t>(b));
  }

  void gather(std::size_t block, std::array<std::int64_t, kHalo * kHalo * kHalo>& voxels) const {
    std::array<std::int64_t, 8> near;
    const std::int32_t* at = blocks_ + 3 * block;
    for (int n = 0; n < 8; ++n) {
      const auto found = index_.find(key(at[0] + (n & 1), at[1] + (n >> 1 & 1), at[2] + (n >> 2)));
      near[n] = found == index_.end() ? -1 : found->second;
    }
    for (int x = 0; x < kHalo; ++x)
      for (int y = 0; y < kHalo; ++y)
        for (int z = 0; z < kHalo; ++z) {
          const std::int64_t owner = near[(x >> 3) | (y >> 3) << 1 | (z >> 3) << 2];
          const int offset = ((x & 7) * kEdge + (y & 7)) * kEdge + (z & 7);
          voxels[(x * kHalo + y) * kHalo + z] = owner < 0 ? -1 : owner * kVoxels + offset;
        }
  }

  // The voxel one step along an axis; the caller knows that it exists.
  std::int64_t next(std::int64_t voxel, int axis) const {
    constexpr int kStep[3] = {kEdge * kEdge, kEdge, 1};
    if (voxel / kStep[axis] % kEdge + 1 < kEdge) return voxel + kStep[axis];
    const std::int32_t* at = blocks_ + 3 * (voxel / kVoxels);
    const std::int64_t owner = index_.at(key(at[0] + (axis == 0), at[1] + (axis == 1), at[2] + (axis == 2)));
    return owner * kVoxels + voxel % kVoxels - std::int64_t{kEdge - 1} * kStep[axis];
  }

 private:
  const std::int32_t* blocks_;
  std::unordered_map<std::uint64_t, std::int64_t> index_;
};

constexpr int kStride[3] = {kHalo * kHalo, kHalo, 1};

int corner_offset(int corner) {
  return (corner & 1) * kStride[0] + (corner >> 1 & 1) * kStride[1] + (corner >> 2) * kStride[2];
}

// Faces of one block as triples of edge keys: 3 * (voxel at the edge's lower end) + axis.
void mesh_block(const Halo& halo, std::size_t block, const float* values, std::vector<std::int64_t>& corners) {
  std::array<std::int64_t, kHalo * kHalo * kHalo> voxels;
  halo.gather(block, voxels);
  for (int x = 0; x < kEdge; ++x)
    for (int y = 0; y < kEdge; ++y)
      for (int z = 0; z < kEdge; ++z) {
        const int cell = (x * kHalo + y) * kHalo + z;
        int inside = 0;
        bool whole = true;
        for (int c = 0; c < 8 && whole; ++c) {
          const std::int64_t voxel = voxels[cell + corner_offset(c)];
          const float value = voxel < 0 ? std::numeric_limits<float>::quiet_NaN() : values[voxel];
          whole = !std::isnan(value);
          inside |= (value < 0.0f) << c;
        }
        if (!whole) continue;
        for (const auto& triangle : patterns()[inside])
          for (const int edge : triangle) corners.push_back(3 * voxels[cell + corner_offset(edge / 3)] + edge % 3);
      }
}

}  // namespace

Isosurface isosurface(const std::int32_t* blocks, std::size_t count, const float* values) {
  patterns();  // made before threads ask for it
  const Halo halo(blocks, count);
  std::vector<std::vector<std::int64_t>> corners(count);
  parallel_for(count, 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t b = begin; b < end; ++b) mesh_block(halo, b, values, corners[b]);
  });

  std::vector<std::int32_t> vertex_of(count * kVoxels * 3, -1);
  Isosurface surface;
  for (auto& block : corners) {
    for (const std::int64_t corner : block) {
      std::int32_t& vertex = vertex_of[corner];
      if (vertex < 0) {
        vertex = static_cast<std::int32_t>(surface.edges.size() / 2);
        surface.edges.push_back(corner / 3);
        surface.edges.push_back(halo.next(corner / 3, static_cast<int>(corner % 3)));
      }
      surface.faces.push_back(vertex);
    }
    block = {};
  }
  return surface;
}

}  // namespace goc
