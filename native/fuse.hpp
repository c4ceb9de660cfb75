// Fusing posed depth images into sums over voxels: KinectFusion (Newcombe et al. 2011) on sparse blocks, with votes.
#pragma once
#include <cstddef>
#include <cstdint>

#include "camera.hpp"

namespace goc {

inline constexpr int kBlockEdge = 8;
inline constexpr int kBlockVoxels = kBlockEdge * kBlockEdge * kBlockEdge;

// What a voxel accumulates; see fuse_view.
enum Sum { kDistance, kWeight, kViews, kOther, kEmpty, kRed, kGreen, kBlue, kSums };

// Voxel (i, j, k) is centred at origin + voxel (i, j, k), world.
struct Lattice {
  double origin[3];
  double voxel;
  double truncation;
};

struct DepthView {
  Camera camera;
  const float* depth;           // z; NaN = none, which with a slope makes all distances along the ray NaN
  const float* slope;           // cosine between ray and surface normal, (0, 1]; NaN: ignore the pixel
  const std::int16_t* ids;      // null: every pixel is the surface wanted
  const std::uint8_t* colours;  // rgb; null: not wanted
};

// Adds one view to `sums` (kSums, count, 8, 8, 8). Rays of pixels whose id is `wanted` that end within the truncation
// add to distance, weight, views and colour; those of other ids that end there to `other`; rays that pass to `empty`.
void fuse_view(const Lattice& lattice, const std::int32_t* blocks, std::size_t count, const DepthView& view,
               int wanted, float* sums);

// Cosine between each pixel's ray and the plane through the pixels within `radius` whose depth agrees (relative); NaN
// where fewer than `fewest` do: a flying pixel at a silhouette.
void depth_slope(const float* depth, const Lens& lens, int radius, double agree, int fewest, float* slope);

}  // namespace goc
