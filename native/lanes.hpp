// The vector kernels as plain functions: one table for each instruction set, one of which is picked at load time.
#pragma once
#include <cstddef>
#include <cstdint>

#include "camera.hpp"

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

constexpr float kNear = 0.01f;      // as gsplat
constexpr float kDilation = 0.3f;   // px², the low-pass filter of 3D Gaussian Splatting (gsplat's eps2d)

// Sixteen splats, one a lane: their parameters, or gradients of those.
struct alignas(64) SplatLanes {
  float mean[3][16], quat[4][16], log_scale[3][16], opacity_logit[16];
};
// Sixteen splats on the image plane, or gradients there.
struct alignas(64) ProjectedLanes {
  float splat[8][16];  // the fields of Splat2D. Gradients: the six geometry numbers of a record
  float plane[4][16];  // normal (camera axes, towards the camera) and distance. Gradients: the same, or of the depth
};

// Where sixteen splats touch the image, in blocks of its tiles.
struct alignas(64) Footprints {
  std::int32_t first_x[16], last_x[16], first_y[16], last_y[16];  // box of {alpha ≥ 1/255}: [first, last)
  float slope_x[16], slope_y[16];  // the least exponent along a row of pixels lies at slope_x·dy, along a column slope_y·dx
  std::uint16_t window[16];        // touched blocks of the 4×4 that start with the box
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
  float beta1, beta2, epsilon;
  const float* rates;  // of sixteen rows: 16·width numbers
  int width;
};
// Parameters (rows, width) with their gradient and moments.
struct AdamRows {
  float* x;
  const float* grad;
  float *first, *second;
};

// One row of L_dn. Depth and normals are NaN where there are none; depth may be read one pixel to either side.
struct NormalRow {
  const float *above, *depth, *below;  // depth of three rows
  const float* normal[3];
  const float* alpha;
  float first_x, step_x, ray_y, step_y;  // rays: x = first_x + i·step_x of pixel i; y of the row, and to the next
};
// One row of the gradient: what normal_row of the row itself and of its neighbours says about this row's depths.
struct DepthGradRow {
  const float *depth, *prior, *denominator;
  const float *from_left, *from_right, *from_above, *from_below;  // null without normals
  float depth_scale, normal_scale;
};

// Row y of a view against a neighbour; see multiview.hpp. Images start at the row, those of three planes are `plane` apart.
struct PairRow {
  const float *numerator, *denominator, *alpha;
  const std::uint8_t* image;
  int y;
  Lens lens;                         // of the view
  const std::uint8_t* source_image;  // the neighbour's
  Lens source_lens;
  const float* inverse_depth;        // what it sees, 0 = none
  Lens depth_lens;
  const float* from_view;            // (3, 4)
  float tolerance;
  std::size_t plane;
  float *depth, *known;
  float *warped, *seen, *slope;      // three planes each; null without L_pho
  float* geometric_grad;             // null without L_geo
  float* pulls;                      // three planes: u, v, and how much the neighbour's depth is pulled there; may be null
};

// Another photograph along a row of this one: sample i is at (start + i·step)/z, in pixels between centres.
struct WarpedRow {
  const std::uint32_t* quads;  // see stereo.hpp
  int stride;
  float last_x, last_y;        // the last pixel's centre
  float start[3], step[3];
};

constexpr int kPatchLanes = 16;
constexpr int kPatchSide = 4;   // samples along a side of a window, kPatchSpacing pixels apart
constexpr float kPatchSpacing = 2.0f;
constexpr int kPatchSamples = kPatchSide * kPatchSide;

// Windows round sixteen pixels, weighted by likeness of grey to the middle.
struct Patches {
  float x[kPatchLanes], y[kPatchLanes];
  float grey[kPatchSamples][kPatchLanes], weight[kPatchSamples][kPatchLanes];  // weights sum to 1
  float mean[kPatchLanes], scale[kPatchLanes];                                 // scale: 1/√(variance + kGreyNoise²)
};

// Another photograph, and how pixels with inverse depth land in it.
struct Target {
  const std::uint32_t* quads;
  int stride;
  float last_x, last_y;
  float m[9], t[3];
};

// A row of pixels whose planes are fitted; see plane_normals.hpp.
struct FitRow {
  const float* const* depth;  // 2·radius + 1 rows, which start `radius` pixels before the first; NaN outside the image
  int width, radius;
  float agree, fewest;
  float fx, fy, cx;
  float from_centre;          // y + ½ − cy
};

// A depth image, and how the voxels of a lattice land in it; see fuse.hpp.
struct FusedView {
  Lens lens;
  float step[3][3];            // from a voxel to the next along each axis of the lattice, camera space
  float voxel, truncation;
  float fade;                  // 1/(truncation − voxel)
  float clear;                 // distance beyond which a ray does nothing but pass
  const float *depth, *slope;
  const std::int16_t* ids;     // may be null
  const std::uint8_t* colours; // may be null
  int wanted;
};

constexpr float kGreyNoise = 0.4f;  // of 255: windows with less contrast match nothing, and nothing speaks against them
constexpr int kWindow = 2;          // half-width of the sweep's windows

struct Kernels {
  const char* name;
  // Bit l is set when splat l is before the camera and its box in the image; footprints are those of such splats.
  std::uint32_t (*project_lanes)(const SplatLanes& in, const DrawCamera& camera, bool planes, ProjectedLanes& out,
                                 Footprints& footprints);
  // planes, depths: the gradient has those of the planes, or of the depths of the centres.
  void (*project_lanes_backward)(const SplatLanes& in, const DrawCamera& camera, const ProjectedLanes& grad,
                                 bool planes, bool depths, SplatLanes& out);
  // The first `count` spherical harmonics (1, 4, 9 or 16) of the directions from `eye` to the splats.
  void (*harmonics_lanes)(const SplatLanes& in, const float* eye, int count, float (*out)[16]);
  // Bit b is set when the splat reaches alpha ≥ 1/255 somewhere in the hull of the pixel centres of block b of the 4×4
  // from pixel (x, y) on. Slopes are those of its footprint.
  std::uint16_t (*touched_blocks)(const Splat2D& splat, float slope_x, float slope_y, int x, int y);
  // Writes the tile's pixels of image[c] (height, width) for each channel of the pass, and of alpha (height, width).
  // scratch: 16·count integers.
  void (*forward_tile)(const TileView& tile, float* const* image, float* alpha, std::uint32_t* scratch);
  // The splat at which each pixel's transmittance falls below one half, as a float; -1 where none does.
  void (*median_tile)(const TileView& tile, float* median, std::uint32_t* scratch);
  // Writes gradient_floats(channel_count) floats a record at grads + slot·grad_stride (64-byte aligned):
  // [Σg, Σg·dx, Σg·dy, Σg·dx², Σg·dx·dy, Σg·dy²] with g = dL/d ln alpha (zeros if channels_only), then dL/dchannel.
  // image_grad[c] and alpha_grad may be null: zeros.
  void (*backward_tile)(const TileView& tile, const float* const* image, const float* alpha,
                        const float* const* image_grad, const float* alpha_grad, bool channels_only, float* grads,
                        int grad_stride);
  // Rows of L_c, `pitch` floats long (a multiple of 16); x and y start kSsimRadius before the first pixel and are zero
  // outside the row, up to pitch + 2·kSsimRadius. Writes five rows: x, y, x², y², xy under the window along the row.
  void (*moments_row)(const float* x, const float* y, int pitch, float* out);
  // rows: 2·kSsimRadius + 1 times five such rows. Sum of SSIM, and its gradient for the moments x, x² and xy.
  float (*ssim_row)(const float* const* rows, int width, int pitch, float* grad_mean, float* grad_xx, float* grad_xy);
  // The window along one row; padded as x above.
  void (*maps_row)(const float* padded, int pitch, float* out);
  // rows: 2·kSsimRadius + 1 times three rows, blurred gradients of the moments. The gradient of L_c at x, and the sums
  // of |x − y| and of (clamp(x) − y)².
  void (*photometric_row)(const float* const* rows, const float* x, const float* y, int width, int pitch,
                          float scale_ssim, float scale_l1, float* grad, float* sums);
  // Rows of L_d and L_dn; every array may be read up to the next multiple of 16 past `width`.
  // depth = numerator / denominator where something was rendered, else NaN; sums: Σ |depth − prior| and how many.
  void (*depth_row)(const float* numerator, const float* denominator, const float* alpha, const float* prior, int width,
                    float* depth, float* sums);
  void (*normal_row)(const NormalRow& row, int width, float* const* out, float* sums);
  void (*depth_grad_row)(const DepthGradRow& row, int width, float* numerator_grad, float* denominator_grad);
  // plane: rows of blended normals (3) and plane distance. Their fraction at rays (first_x + i·step_x, ray_y, 1).
  void (*fraction_row)(const float* const* plane, float first_x, float step_x, float ray_y, int width,
                       float* numerator, float* denominator);
  void (*fraction_grad_row)(const float* numerator_grad, const float* denominator_grad, float first_x, float step_x,
                            float ray_y, int width, float* const* plane_grad);
  // Adds opacity·o(1 − o) to the gradient of each logit that has one, and scale·exp(s) to those of its log scales.
  void (*penalty_rows)(const float* logits, const float* log_scales, std::size_t count, float opacity, float scale,
                       float* logits_grad, float* log_scales_grad);
  void (*adam_rows)(const AdamRows& rows, std::size_t count, const AdamStep& step);
  // Fills the row's images, every pixel of them, 0 where nothing is known. error: Σ w·e of L_geo; smooth: its pixels.
  void (*pair_row)(const PairRow& row, float* error, int* smooth);
  // Of a row of an image (three rows are read) the sums over 3 columns of x, y, x², y², xy: five rows.
  void (*block_columns)(const float* x, const float* y, int width, float* out);
  // From such sums the SSIM of the blocks round pixels 1 to width − 2 that are counted (1, else 0): its derivatives by a
  // block's mean x, x² and xy, and the sum of Eq. (5).
  float (*block_row)(const float* columns, const float* counted, const float* x, const float* y, int width,
                     float* by_mean, float* by_square, float* by_product);
  // Gradient of Eq. (5) for a row of x, from columns of the three derivatives with a zero on either side.
  void (*block_grad_row)(const float* const* columns, const float* x, const float* y, const float* counted, int width,
                         float* out);
  // Greys of a warped row, and 1 where they lie inside the photograph, else 0.
  void (*warp_row)(const WarpedRow& warp, int width, float* greys, float* inside);
  // 1 − ZNCC of a row's windows in [0, 1], 1 outside; rows are the window's, of both images. scratch: 3·(width + 4).
  void (*match_row)(const float* const* rows, const float* const* warped, const float* mean, const float* scale,
                    const float* inside, int width, float* scratch, float* costs);
  // Keeps the three smallest costs of each pixel.
  void (*keep_best)(const float* costs, int width, float* first, float* second, float* third);
  // One pixel's step of a semi-global path: now = costs + min(before, its neighbours + step, best_before + jump) −
  // best_before, added to total; returns the least of now. `planes` is a multiple of 16, before has one float on
  // either side that is large.
  float (*path_step)(const float* costs, const float* before, float best_before, float step, float jump, int planes,
                     float* now, float* total);
  // 1 − ZNCC in [0, 1] of patches on the planes q + gx·dx + gy·dy of inverse depth; 1 where they land outside.
  void (*patch_costs)(const Patches& patches, const Target& target, const float* q, const float* gx, const float* gy,
                      float* costs);
  // Normals of one row, three rows of floats; like the depths, they have room up to the next multiple of 16.
  void (*plane_normal_row)(const FitRow& row, float* const* normal);
  // Adds a view to the sums of the block whose first voxel is at `first`, camera space; sum s of voxel i is at
  // sums[s·stride + i]. passed: all rays pass through all of it.
  void (*fuse_block)(const FusedView& view, const float* first, bool passed, float* sums, std::size_t stride);
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
