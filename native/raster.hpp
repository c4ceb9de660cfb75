// The splat engine on a CPU: project, bin, blend, and the gradient of it all.
#pragma once
#include <cstdint>
#include <vector>

#include "bins.hpp"
#include "lanes.hpp"

namespace goc {

// n splats as stored for optimisation: means (n 3), quats wxyz (n 4), log_scales (n 3), opacity_logits (n).
struct SplatArrays {
  const float *means, *quats, *log_scales, *opacity_logits;
  std::size_t size;
};
struct SplatGradients {
  float *means, *quats, *log_scales, *opacity_logits;
};

// What is blended: of a training view (sh given) colour by spherical harmonics (3), then the splats' planes (camera-axes
// normal towards the camera, plane distance: 4) or the z of their centres (1); then features as given.
struct Channels {
  const float* sh = nullptr;  // (n, harmonics, 3)
  int harmonics = 0;
  bool planes = false;
  const float* features = nullptr;  // (n, feature_count)
  int feature_count = 0;
  float eye[3] = {};  // of the camera, world

  int count() const { return (sh ? (planes ? 7 : 4) : 0) + feature_count; }
};
struct ChannelGradients {
  float *sh, *features;
};

// A vector of floats that starts on a cache line and grows without keeping its contents.
class Lines {
 public:
  float* resized(std::size_t floats);
  std::size_t bytes() const { return floats_.capacity() * sizeof(float); }

 private:
  std::vector<float> floats_;
};

// One rendered view: what backward needs to know of forward. Buffers keep their capacity between uses.
class Raster {
 public:
  // Fills image[c] (height, width) for every channel, and alpha (height, width).
  void forward(const SplatArrays& splats, const Channels& channels, const DrawCamera& camera, float* const* image,
               float* alpha);
  // Gradients with respect to the splats (null `out` when only channels are wanted) and the channels. Every row is
  // written, with zeros where a splat is not in view. image_grad[c] and alpha_grad may be null: zeros.
  void backward(const SplatArrays& splats, const Channels& channels, const float* const* image, const float* alpha,
                const float* const* image_grad, const float* alpha_grad, const SplatGradients* out,
                const ChannelGradients& channels_out);
  // The splat at which each pixel (height, width) of the last forward turns half opaque; -1 where none does.
  void median(std::int32_t* out) const;
  std::size_t records() const { return bins_.records(); }
  std::size_t blocks() const { return bins_.blocks(); }  // (record, block of 4×4 pixels) pairs
  // Capacity of all buffers: once they have seen the largest view, a step adds nothing.
  std::size_t bytes() const { return rows_lines_.bytes() + grads_lines_.bytes() + bins_.bytes(); }
  const DrawCamera& camera() const { return camera_; }
  int width() const { return camera_.width; }
  int height() const { return camera_.height; }

 private:
  void project_all(const SplatArrays& splats, const Channels& channels);
  TileView tile(std::size_t index, int pass) const;
  const float* gather_passes(std::vector<float>& sum, int lane, ProjectedLanes& grad) const;
  void splats_backward(const SplatArrays& splats, const Channels& channels, std::size_t first, int count,
                       const float* grads, int stride, std::vector<float>& sum, const SplatGradients* out,
                       const ChannelGradients& channels_out);
  int passes() const { return (channel_count_ + kMaxChannels - 1) / kMaxChannels; }
  int channels_of(int pass) const;

  DrawCamera camera_{};
  int channel_count_ = 0, row_stride_ = 0;
  std::size_t size_ = 0;
  Lines rows_lines_, grads_lines_;
  float* rows_ = nullptr;  // a splat: Splat2D, channels
  Bins bins_;
};

}  // namespace goc
