// The vector kernels as plain functions: one table for each instruction set, one of which is picked at load time.
#pragma once
#include <cstddef>
#include <cstdint>

namespace goc {

constexpr int kTile = 16;             // a tile is 16×16 pixels
constexpr int kBlock = 4;             // of 4×4 blocks of 4×4 pixels
constexpr int kMaxChannels = 32;      // of one pass over a tile; more channels take more passes
constexpr float kMinAlpha = 1.0f / 255.0f;
constexpr float kMaxAlpha = 0.999f;   // gsplat 1.5.3; 1.6 says 0.99
constexpr float kMinTransmittance = 1e-4f;
constexpr float kLog2Of255 = 7.994353436858858f;

// A splat on the image plane: alpha(p) = 2^(log2_opacity − a·dx² − b·dx·dy − c·dy²), (dx, dy) = p − (x, y).
struct Splat2D {
  float x, y, a, b, c, log2_opacity, depth, unused;
};

constexpr int kPacked = 8;            // floats of a Splat2D
constexpr int kGeometry = 6;          // of a record's gradient, before its channels

// Channels that the kernels know: a pass is padded with zeros to the next such number.
constexpr int padded_channels(int count) {
  if (count <= 8) return count;
  if (count <= 12) return 12;
  if (count <= 16) return 16;
  return count <= 24 ? 24 : kMaxChannels;
}
// Floats of a record's gradient in one pass: whole Lanes.
constexpr int gradient_floats(int channels) { return (kGeometry + padded_channels(channels) + 15) / 16 * 16; }

// One tile's depth-sorted records, (splat, tile) pairs, and where its pixels live.
struct TileView {
  const float* rows;           // of all splats: a Splat2D, then its channels
  int row_stride;
  const std::uint32_t* order;  // splats that touch the tile, near to far
  const std::uint16_t* masks;  // which of the tile's 16 blocks each touches
  const std::uint32_t* slots;  // where the gradient of each goes
  int count;
  int x0, y0;                  // first pixel
  int width, height;           // of the image
  int channel_offset;          // of this pass, in a row
  int channel_count;           // of this pass, at most kMaxChannels; zeros follow in the row up to padded_channels
};

// Adam with its bias corrections folded in: rate = lr·√(1 − β2^t)/(1 − β1^t), epsilon scaled by √(1 − β2^t).
struct AdamStep {
  float rate, beta1, beta2, epsilon;
};

struct Kernels {
  const char* name;
  // Bit b is set when the splat reaches alpha ≥ 1/255 somewhere in the hull of the pixel centres of block b.
  std::uint16_t (*touched_blocks)(const Splat2D& splat, float tile_x, float tile_y);
  // Writes the tile's pixels of image[c] (height, width) for each channel of the pass, and of alpha (height, width).
  // scratch: 16·count integers.
  void (*forward_tile)(const TileView& tile, float* const* image, float* alpha, std::uint32_t* scratch);
  // The splat at which each pixel's transmittance falls below one half, as a float; -1 where none does.
  void (*median_tile)(const TileView& tile, float* median, std::uint32_t* scratch);
  // Writes gradient_floats(channel_count) floats a record at grads + slot·grad_stride (64-byte aligned):
  // [Σg, Σg·dx, Σg·dy, Σg·dx², Σg·dx·dy, Σg·dy²] with g = dL/dlog2_alpha (zeros if channels_only), then dL/dchannel.
  // image_grad[c] and alpha_grad may be null: zeros.
  void (*backward_tile)(const TileView& tile, const float* const* image, const float* alpha,
                        const float* const* image_grad, const float* alpha_grad, bool channels_only, float* grads,
                        int grad_stride);
  // out[i] = Σ_k taps[k]·padded[i + k]: a row's convolution; padded has width + 2·kSsimRadius floats.
  void (*blur_row)(const float* padded, int width, float* out);
  // out[i] = Σ_k taps[k]·rows[k][i]: a column's; a null row counts as zeros.
  void (*blur_column)(const float* const* rows, int width, float* out);
  // SSIM of one row from the blurred moments, and its gradient with respect to the three that depend on x.
  double (*ssim_row)(const float* mean_x, const float* mean_y, const float* xx, const float* yy, const float* xy,
                     int width, float* grad_mean, float* grad_xx, float* grad_xy);
  void (*adam_run)(float* x, const float* g, float* m, float* v, std::size_t count, const AdamStep& step);
};

constexpr int kSsimRadius = 5;  // 11 taps, sigma 1.5 pixels (Wang et al. 2004)

// Kernels of the best instruction set of this machine (or of GOC_SIMD=portable|avx2|avx512 in the environment).
const Kernels& kernels();

namespace portable { extern const Kernels kKernels; }
#ifdef GOC_X86_64
namespace avx2 { extern const Kernels kKernels; }
namespace avx512 { extern const Kernels kKernels; }
#endif

}  // namespace goc
