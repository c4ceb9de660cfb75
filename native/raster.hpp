// The splat engine on a CPU: project, bin, blend, and the gradient of it all.
#pragma once
#include <cstdint>
#include <vector>

#include "lanes.hpp"

namespace goc {

// Pinhole camera, OpenCV axes; view is cam_from_world, row-major 4×4.
struct RasterCamera {
  float view[16];
  float fx, fy, cx, cy;
  int width, height;
};

// n splats as stored for optimisation: means (n 3), quats wxyz (n 4), log_scales (n 3), opacity_logits (n).
struct SplatArrays {
  const float *means, *quats, *log_scales, *opacity_logits;
  std::size_t size;
};
struct SplatGradients {
  float *means, *quats, *log_scales, *opacity_logits;
};

constexpr float kNear = 0.01f;      // as gsplat
constexpr float kDilation = 0.3f;   // px², the low-pass filter of 3D Gaussian Splatting (gsplat's eps2d)

// Splat → image plane (Zwicker et al. 2001). False when the splat cannot reach alpha 1/255 in front of the camera.
// reach: half-width and half-height of the smallest box round {alpha ≥ 1/255}, pixels.
bool project(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, Splat2D& out, float reach[2]);

// grad: [Σg, Σg·dx, Σg·dy, Σg·dx², Σg·dx·dy, Σg·dy²] of lanes.hpp. Writes row i of every array in `out`.
void project_backward(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, const Splat2D& projected,
                      const float grad[6], const SplatGradients& out);

// One rendered view: what backward needs to know of forward. Buffers keep their capacity between uses.
class Raster {
 public:
  // Fills image (channels, height, width) and alpha (height, width).
  void forward(const SplatArrays& splats, const float* channels, int channel_count, const RasterCamera& camera,
               float* image, float* alpha);
  // Gradients with respect to the splats (null `out` when only channels are wanted) and to channels (n, channel_count).
  void backward(const SplatArrays& splats, const float* channels, const float* image, const float* alpha,
                const float* image_grad, const float* alpha_grad, const SplatGradients* out, float* channels_grad);
  // The splat at which each pixel (height, width) of the last forward turns half opaque; -1 where none does.
  void median(std::int32_t* out) const;
  // Splats that touch some tile of the view.
  void visible(std::uint8_t* out) const;
  std::size_t records() const { return order_.size(); }
  int width() const { return camera_.width; }
  int height() const { return camera_.height; }

 private:
  struct Candidate {       // a (splat, tile) pair of the splat's bounding box
    std::uint32_t record;  // its place in the tile's list, kNoRecord if the ellipse misses the tile
    std::uint16_t mask;
  };
  void project_all(const SplatArrays& splats);
  void sort_by_depth();
  void bin();
  TileView tile(std::size_t index, const float* channels, int first_channel) const;

  RasterCamera camera_{};
  int channel_count_ = 0, tiles_x_ = 0, tiles_y_ = 0;
  std::vector<Splat2D> splats_;
  struct Box { std::int16_t x0, y0, x1, y1; };  // tiles, end excluded; empty when the splat is not visible
  std::vector<Box> boxes_;
  std::vector<std::uint32_t> by_depth_;  // visible splats, near to far
  std::vector<std::uint32_t> rank_;      // of each splat in by_depth_
  std::vector<std::uint64_t> keys_, keys_scratch_;
  std::vector<std::size_t> candidate_begin_;            // of by_depth_[k]
  std::vector<Candidate> candidates_;
  std::vector<std::uint32_t> tile_begin_, histogram_;
  std::vector<std::uint32_t> order_;                    // records: splat, grouped by tile, near to far
  std::vector<std::uint16_t> masks_;
  std::vector<float> grads_;
};

}  // namespace goc
