// The splat engine on a CPU: project, bin, blend, and the gradient of it all.
#pragma once
#include <cstdint>
#include <vector>

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
  void forward(const SplatArrays& splats, const Channels& channels, const RasterCamera& camera, float* const* image,
               float* alpha);
  // Gradients with respect to the splats (null `out` when only channels are wanted) and the channels. Every row is
  // written, with zeros where a splat is not in view. image_grad[c] and alpha_grad may be null: zeros.
  void backward(const SplatArrays& splats, const Channels& channels, const float* const* image, const float* alpha,
                const float* const* image_grad, const float* alpha_grad, const SplatGradients* out,
                const ChannelGradients& channels_out);
  // The splat at which each pixel (height, width) of the last forward turns half opaque; -1 where none does.
  void median(std::int32_t* out) const;
  // Splats that touch some tile of the view.
  void visible(std::uint8_t* out) const;
  std::size_t records() const { return order_.size(); }
  std::size_t blocks() const;  // (record, block of 4×4 pixels) pairs
  std::size_t bytes() const;   // capacity of all buffers: once they have seen the largest view, a step adds nothing
  const RasterCamera& camera() const { return camera_; }
  int width() const { return camera_.width; }
  int height() const { return camera_.height; }

 private:
  struct Touch {  // a tile that a splat reaches
    std::uint16_t x, y, mask;
  };
  struct Range {  // of a splat's touches
    std::uint32_t begin, count;
  };
  void project_all(const SplatArrays& splats, const Channels& channels);
  void sort_by_depth();
  void bin();
  TileView tile(std::size_t index, int pass) const;
  void touch(const Splat2D& splat, float reach_x, float reach_y, std::vector<Touch>& touches) const;
  const float* gather_passes(std::vector<float>& sum, int lane, ProjectedLanes& grad) const;
  void splats_backward(const SplatArrays& splats, const Channels& channels, std::size_t first, int count,
                       const float* grads, int stride, std::vector<float>& sum, const SplatGradients* out,
                       const ChannelGradients& channels_out);
  int passes() const { return (channel_count_ + kMaxChannels - 1) / kMaxChannels; }
  int channels_of(int pass) const;

  RasterCamera camera_{};
  int channel_count_ = 0, tiles_x_ = 0, tiles_y_ = 0, row_stride_ = 0;
  std::size_t size_ = 0;
  Lines rows_lines_, grads_lines_;
  float* rows_ = nullptr;                     // a splat: Splat2D, channels
  std::vector<std::vector<Touch>> touches_;   // of each chunk of splats
  std::vector<std::uint32_t> chunk_begin_;    // first record of each chunk
  std::vector<Range> ranges_;                 // of each splat in its chunk's touches
  std::vector<std::uint32_t> by_depth_;       // visible splats, near to far
  std::vector<std::uint64_t> keys_, keys_scratch_;
  std::vector<std::uint32_t> tile_begin_, histogram_;
  // Records, grouped by tile, near to far: splat, blocks, and where the gradient goes (all records of a splat together).
  std::vector<std::uint32_t> order_, slots_;
  std::vector<std::uint16_t> masks_;
};

}  // namespace goc
