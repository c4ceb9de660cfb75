// One splat as a camera sees it; what raster.cpp and channels.cpp share.
#pragma once
#include "raster.hpp"

namespace goc {

// V = cam_from_splat axes · scales, J the Jacobian of the projection, P = J V.
struct Seen {
  float t[3];         // centre, camera axes
  float rotation[9];  // world from splat
  float scale[3];
  float v[9];         // 3×3, row-major
  float j00, j02, j11, j12;
  bool clamped_x, clamped_y;
  float p[6];         // 2×3
  float opacity;
  float xx, xy, yy;   // covariance on the image plane, px²
};

// False when the splat is behind the camera or nowhere visible.
bool see(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, Seen& seen);

// Splat → image plane (Zwicker et al. 2001). False when it cannot reach alpha 1/255.
// reach: half-width and half-height of the smallest box round {alpha ≥ 1/255}, pixels.
bool project(const Seen& seen, const RasterCamera& camera, Splat2D& out, float reach[2]);

// What reaches a splat past its projection: from channels that depend on its place and rotation.
struct Pull {
  float centre[3];    // camera axes
  float rotation[9];  // world from splat
};

// grad: [Σg, Σg·dx, Σg·dy, Σg·dx², Σg·dx·dy, Σg·dy²] of lanes.hpp. Writes row i of every array in `out`.
void project_backward(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, const Seen& seen,
                      const Splat2D& projected, const float grad[6], const Pull& pull, const SplatGradients& out);

// Writes splat i's channels.count() numbers.
void fill_channels(const Channels& channels, const SplatArrays& splats, std::size_t i, const RasterCamera& camera,
                   const Seen& seen, float* out);
// Writes row i of every array in `out`; adds what reaches the splat's place and rotation to `pull`.
void channels_backward(const Channels& channels, const SplatArrays& splats, std::size_t i, const RasterCamera& camera,
                       const Seen& seen, const float* values, const float* grad, const ChannelGradients& out,
                       Pull& pull);

}  // namespace goc
