#include "multiview.hpp"

#include <algorithm>
#include <cmath>

#include "threads.hpp"

namespace goc {
namespace {

constexpr float kMinAlpha = 0.5f;         // below, no surface was rendered
constexpr float kMinDenominator = 0.01f;  // below, planes are seen edge-on
constexpr float kMaxError = 1.0f;         // pixels: beyond, two depths show two surfaces
constexpr int kColours = 3;
constexpr std::size_t kRowGrain = 8;

struct Vec3 {
  float x, y, z;
};
float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// The rotation of a (3, 4) rigid transform, and its inverse.
Vec3 turn(const float* m, Vec3 v) {
  return {m[0] * v.x + m[1] * v.y + m[2] * v.z, m[4] * v.x + m[5] * v.y + m[6] * v.z,
          m[8] * v.x + m[9] * v.y + m[10] * v.z};
}
Vec3 turn_back(const float* m, Vec3 v) {
  return {m[0] * v.x + m[4] * v.y + m[8] * v.z, m[1] * v.x + m[5] * v.y + m[9] * v.z,
          m[2] * v.x + m[6] * v.y + m[10] * v.z};
}

// The four pixel centres round a place in an image.
struct Corners {
  std::size_t first = 0;  // the upper left one
  float x = 0, y = 0;     // place between them, 0 to 1
  bool inside = false;
};

Corners corners(const Lens& lens, float u, float v) {
  u -= 0.5f, v -= 0.5f;
  if (!(u >= 0 && v >= 0 && u < (float)(lens.width - 1) && v < (float)(lens.height - 1))) return {};
  const int x = (int)u, y = (int)v;
  return {(std::size_t)y * lens.width + x, u - (float)x, v - (float)y, true};
}

// A bilinear value and its slopes per pixel.
struct Bilinear {
  float value = 0, du = 0, dv = 0;
};

Bilinear bilinear(const Corners& at, float a, float b, float c, float d) {
  const float top = a + at.x * (b - a), bottom = c + at.x * (d - c);
  return {top + at.y * (bottom - top), (1 - at.y) * (b - a) + at.y * (d - c), bottom - top};
}

}  // namespace

// Where a pixel's point is in the neighbour, how that moves with its depth D, and the surface that is seen there.
struct MultiviewLoss::Landing {
  float x, y, z;      // x/z, y/z and z, the neighbour's camera axes
  float dx, dy;       // of x/z and y/z by D
  float u, v;         // in the neighbour's depth image
  float inverse = 0;  // 1/z of the surface there, linear between pixels, as it is on a plane
  float d_inverse = 0;
  bool known = false;   // all four pixels have a depth
  bool smooth = false;  // and show one surface

  Landing(const WarpSource& source, Vec3 ray, float depth, float tolerance) {
    const float* m = source.from_view;
    const Lens& lens = source.depth_lens;
    const Vec3 a = turn(m, ray);
    z = a.z * depth + m[11];
    const float scale = 1.0f / z;
    x = (a.x * depth + m[3]) * scale, y = (a.y * depth + m[7]) * scale;
    dx = (a.x - x * a.z) * scale, dy = (a.y - y * a.z) * scale;
    u = lens.fx * x + lens.cx, v = lens.fy * y + lens.cy;
    const Corners at = corners(lens, u, v);
    if (!at.inside || !(z > 0)) return;
    const float* p = source.inverse_depth + at.first;
    const float q[4] = {p[0], p[1], p[lens.width], p[lens.width + 1]};
    const float low = std::min({q[0], q[1], q[2], q[3]}), high = std::max({q[0], q[1], q[2], q[3]});
    const Bilinear found = bilinear(at, q[0], q[1], q[2], q[3]);
    known = low > 0;
    smooth = known && high <= (1 + tolerance) * low;
    inverse = found.value;
    d_inverse = found.du * lens.fx * dx + found.dv * lens.fy * dy;
  }
};

MultiviewLosses MultiviewLoss::operator()(const WarpedView& view, const WarpSource& source,
                                          const MultiviewWeights& weights, float* numerator_grad,
                                          float* denominator_grad, float* inverse_grad) {
  const int w = view.lens.width, h = view.lens.height;
  const std::size_t size = (std::size_t)w * h;
  depth_.resize(size);
  for (auto* images : {&warped_, &seen_, &slope_}) images->assign(size * kColours, 0.0f);
  warped_grad_.resize(size * kColours);
  known_.assign(size, 0.0f);
  geometric_grad_.assign(size, 0.0f);
  pulls_.assign(inverse_grad ? size : 0, {});
  geometric_sums_.assign(h, {});
  parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (int y = (int)begin; y < (int)end; ++y)
      for (int x = 0; x < w; ++x) warp_pixel(view, source, weights, x, y);
  });
  PixelSum photometric, geometric;
  if (weights.photometric != 0)
    photometric = ssim_({warped_.data(), seen_.data(), known_.data(), w, h}, warped_grad_.data());
  for (const PixelSum& row : geometric_sums_) geometric += row;
  const std::size_t fewest = std::max<std::size_t>(size / 4, 1);  // a handful of pixels must not pull like a view
  const double pixels = (double)std::max(photometric.pixels, fewest);
  const double matches = (double)std::max(geometric.pixels, fewest);
  const float geometric_scale = (float)(weights.geometric / matches);
  add_to_depth(view, (float)(weights.photometric / pixels), geometric_scale, numerator_grad, denominator_grad);
  if (inverse_grad) scatter_pulls(source.depth_lens, geometric_scale, inverse_grad);
  return {photometric.value / pixels, geometric.value / matches};
}

void MultiviewLoss::warp_pixel(const WarpedView& view, const WarpSource& source, const MultiviewWeights& weights, int x,
                               int y) {
  const Lens& lens = view.lens;
  const std::size_t i = (std::size_t)y * lens.width + x;
  const bool rendered = view.alpha[i] > kMinAlpha && view.denominator[i] > kMinDenominator && view.numerator[i] > 0;
  depth_[i] = rendered ? view.numerator[i] / view.denominator[i] : 0.0f;
  if (!rendered) return;
  const float px = (float)x + 0.5f, py = (float)y + 0.5f;
  const Landing at(source, {(px - lens.cx) / lens.fx, (py - lens.cy) / lens.fy, 1.0f}, depth_[i], weights.tolerance);
  if (!at.known) return;
  // Hidden behind what the neighbour sees: its photograph shows something else.
  if (weights.photometric != 0 && at.z * at.inverse <= 1 + weights.tolerance) fetch_colour(view, source, at, i);
  if (weights.geometric == 0 || !at.smooth) return;
  geometric_sums_[y] += {0.0, 1};
  // There and back: the neighbour's surface point Y in the view's axes, and how far from the pixel it is seen.
  const float* m = source.from_view;
  const float far = 1.0f / at.inverse;
  const Vec3 back = turn_back(m, {at.x * far - m[3], at.y * far - m[7], far - m[11]});
  const float near = 1.0f / back.z;
  const float ex = lens.fx * back.x * near + lens.cx - px, ey = lens.fy * back.y * near + lens.cy - py;
  const float error = std::sqrt(ex * ex + ey * ey);
  if (!(back.z > 0 && error < kMaxError)) return;
  // The weight says how likely both are one surface; it is not optimised.
  const float weight = std::exp(-error);
  geometric_sums_[y] += {(double)weight * error, 0};
  if (!(error > 0)) return;
  const float gx = weight * ex / error * lens.fx * near, gy = weight * ey / error * lens.fy * near;
  const Vec3 pull = turn(m, {gx, gy, -(gx * back.x + gy * back.y) * near});  // of w·e by Y
  const float by_inverse = -dot(pull, {at.x, at.y, 1.0f}) * far * far;
  geometric_grad_[i] = (pull.x * at.dx + pull.y * at.dy) * far + by_inverse * at.d_inverse;
  if (!pulls_.empty()) pulls_[i] = {at.u, at.v, by_inverse};
}

// C̃ and its slope, where the point is in the neighbour's photograph.
void MultiviewLoss::fetch_colour(const WarpedView& view, const WarpSource& source, const Landing& landing,
                                 std::size_t pixel) {
  const Lens& lens = source.lens;
  const Corners at = corners(lens, lens.fx * landing.x + lens.cx, lens.fy * landing.y + lens.cy);
  if (!at.inside) return;
  const std::size_t size = known_.size(), row = (std::size_t)lens.width * kColours;
  const std::uint8_t* p = source.image + at.first * kColours;
  const float du = lens.fx * landing.dx / 255.0f, dv = lens.fy * landing.dy / 255.0f;
  for (int k = 0; k < kColours; ++k) {
    const Bilinear found = bilinear(at, p[k], p[k + kColours], p[k + row], p[k + row + kColours]);
    warped_[k * size + pixel] = found.value / 255.0f;
    slope_[k * size + pixel] = found.du * du + found.dv * dv;
    seen_[k * size + pixel] = view.image[pixel * kColours + k] / 255.0f;
  }
  known_[pixel] = 1.0f;
}

void MultiviewLoss::add_to_depth(const WarpedView& view, float photometric, float geometric, float* numerator_grad,
                                 float* denominator_grad) const {
  const std::size_t size = depth_.size(), w = view.lens.width;
  parallel_for(view.lens.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * w; i < end * w; ++i) {
      float g = geometric * geometric_grad_[i];
      if (photometric != 0)
        for (int k = 0; k < kColours; ++k) g += photometric * warped_grad_[k * size + i] * slope_[k * size + i];
      const float inverse = depth_[i] > 0 ? 1.0f / view.denominator[i] : 0.0f;
      numerator_grad[i] = g * inverse;
      denominator_grad[i] = -g * depth_[i] * inverse;
    }
  });
}

// In one thread: pixels of two rows may pull at one place.
void MultiviewLoss::scatter_pulls(const Lens& lens, float scale, float* inverse_grad) const {
  std::fill(inverse_grad, inverse_grad + (std::size_t)lens.width * lens.height, 0.0f);
  for (const Pull& pull : pulls_) {
    if (pull.amount == 0) continue;
    const Corners at = corners(lens, pull.u, pull.v);
    float* p = inverse_grad + at.first;
    const float amount = scale * pull.amount;
    p[0] += amount * (1 - at.x) * (1 - at.y);
    p[1] += amount * at.x * (1 - at.y);
    p[lens.width] += amount * (1 - at.x) * at.y;
    p[lens.width + 1] += amount * at.x * at.y;
  }
}

}  // namespace goc
