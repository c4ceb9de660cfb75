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

// One tile's depth-sorted splats and where its pixels live.
struct TileView {
  const Splat2D* splats;       // of the whole image
  const std::uint32_t* order;  // splats that touch the tile, near to far
  const std::uint16_t* masks;  // which of the tile's 16 blocks each touches
  int count;
  int x0, y0;                  // first pixel
  int width, height;           // of the image
  const float* channels;       // (splats, channel_stride), first of the pass
  int channel_stride;
  int channel_count;           // of this pass, at most kMaxChannels
  int channel_offset;          // of this pass in a record's gradient
};

// Adam with its bias corrections folded in: rate = lr·√(1 − β2^t)/(1 − β1^t), epsilon scaled by √(1 − β2^t).
struct AdamStep {
  float rate, beta1, beta2, epsilon;
};

struct Kernels {
  const char* name;
  // Bit b is set when the splat reaches alpha ≥ 1/255 somewhere in the hull of the pixel centres of block b.
  std::uint16_t (*touched_blocks)(const Splat2D& splat, float tile_x, float tile_y);
  // Writes the tile's pixels of image (channels, height, width) and alpha (height, width).
  // scratch: count·(8 + channel_count) floats, then 16·count integers.
  void (*forward_tile)(const TileView& tile, float* image, float* alpha, float* scratch);
  // The splat at which each pixel's transmittance falls below one half, as a float; -1 where none does.
  // scratch: as forward_tile with no channels.
  void (*median_tile)(const TileView& tile, float* median, float* scratch);
  // grad of one record: [Σg, Σg·dx, Σg·dy, Σg·dx², Σg·dx·dy, Σg·dy²] with g = dL/dlog2_alpha, then channel_count of
  // dL/dchannel at channel_offset; the six add up over passes. channels_only leaves them alone. alpha_grad may be null.
  void (*backward_tile)(const TileView& tile, const float* image, const float* alpha, const float* image_grad,
                        const float* alpha_grad, bool channels_only, float* grads, int grad_stride, float* scratch);
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
