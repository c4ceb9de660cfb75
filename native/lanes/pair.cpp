// A row of a view against a neighbour, sixteen pixels at a time; see ../multiview.hpp.
#include "kernels.hpp"
#include "powers.hpp"

namespace goc::GOC_ISA {
namespace {

constexpr float kMinAlpha = 0.5f;         // below, no surface was rendered
constexpr float kMinDenominator = 0.01f;  // below, planes are seen edge-on
constexpr float kMaxError = 1.0f;         // pixels: beyond, two depths show two surfaces
constexpr float kLog2E = 1.4426950408889634f;

// The four pixel centres round places in an image.
struct Corners {
  IntLanes first;  // the upper left one
  Lanes x, y;      // place between them, 0 to 1
  Mask inside;
};
GOC_INLINE Corners corners(const Lens& lens, Lanes u, Lanes v, Mask wanted) {
  u = u - 0.5f, v = v - 0.5f;
  const Mask inside = wanted & (u >= 0.0f) & (v >= 0.0f) & (splat((float)(lens.width - 1)) > u) &
                      (splat((float)(lens.height - 1)) > v);
  u = keep(inside, u), v = keep(inside, v);
  const IntLanes x = truncate(u), y = truncate(v);
  return {y * lens.width + x, u - to_float(x), v - to_float(y), inside};
}

// Bilinear values and their slopes per pixel.
struct Bilinear {
  Lanes value, du, dv;
};
GOC_INLINE Bilinear bilinear(const Corners& at, Lanes a, Lanes b, Lanes c, Lanes d) {
  const Lanes top = fma(at.x, b - a, a), bottom = fma(at.x, d - c, c);
  return {fma(at.y, bottom - top, top), fma(1.0f - at.y, b - a, at.y * (d - c)), bottom - top};
}

// Where pixels' points are in the neighbour, how that moves with their depth, and the surface that is seen there.
struct Landing {
  Lanes x, y, z;             // x/z, y/z and z, the neighbour's camera axes
  Lanes dx, dy;              // of x/z and y/z by depth
  Lanes u, v;                // in the neighbour's depth image
  Lanes inverse, d_inverse;  // 1/z of the surface there, linear between pixels, as it is on a plane; and by depth
  Mask known;                // all four pixels have a depth
  Mask smooth;               // and show one surface
};
GOC_INLINE Landing land(const PairRow& row, const Lanes* ray, Lanes depth, Mask wanted) {
  const float* m = row.from_view;
  const Lens& lens = row.depth_lens;
  Landing at;
  at.z = fma(ray[2], depth, splat(m[11]));
  const Lanes scale = splat(1.0f) / at.z;
  at.x = fma(ray[0], depth, splat(m[3])) * scale, at.y = fma(ray[1], depth, splat(m[7])) * scale;
  at.dx = (ray[0] - at.x * ray[2]) * scale, at.dy = (ray[1] - at.y * ray[2]) * scale;
  at.u = fma(at.x, lens.fx, splat(lens.cx)), at.v = fma(at.y, lens.fy, splat(lens.cy));
  const Corners here = corners(lens, at.u, at.v, wanted & (at.z > splat(0.0f)));
  const float *above = row.inverse_depth, *below = above + lens.width;
  const Lanes none = splat(0.0f);
  const Lanes a = gather(above, here.first, here.inside, none), b = gather(above + 1, here.first, here.inside, none);
  const Lanes c = gather(below, here.first, here.inside, none), d = gather(below + 1, here.first, here.inside, none);
  const Lanes low = min(min(a, b), min(c, d)), high = max(max(a, b), max(c, d));
  const Bilinear found = bilinear(here, a, b, c, d);
  at.known = here.inside & (low > none);
  at.smooth = at.known & (high <= low * (1 + row.tolerance));
  at.inverse = found.value;
  at.d_inverse = found.du * lens.fx * at.dx + found.dv * lens.fy * at.dy;
  return at;
}

GOC_INLINE Lanes channel(IntLanes rgb, int k) { return to_float((rgb >> 8 * k) & 255); }

// C̃, its slope, and C, where points are in the neighbour's photograph.
GOC_INLINE void fetch_colours(const PairRow& row, const Landing& at, Mask seen, int first, int count) {
  const Lens& lens = row.source_lens;
  const Corners here = corners(lens, fma(at.x, lens.fx, splat(lens.cx)), fma(at.y, lens.fy, splat(lens.cy)), seen);
  const auto corner = [&](int away) { return gather_rgb(row.source_image, here.first + splat_int(away), here.inside); };
  const IntLanes a = corner(0), b = corner(1), c = corner(lens.width), d = corner(lens.width + 1);
  const IntLanes own = gather_rgb(row.image, truncate(load(kIota) + (float)first), here.inside);
  const Lanes du = at.dx * (lens.fx / 255.0f), dv = at.dy * (lens.fy / 255.0f);
  for (int k = 0; k < 3; ++k) {
    const Bilinear found = bilinear(here, channel(a, k), channel(b, k), channel(c, k), channel(d, k));
    const std::size_t place = k * row.plane + first;
    store_some(row.warped + place, count, keep(here.inside, found.value * (1.0f / 255.0f)));
    store_some(row.slope + place, count, keep(here.inside, fma(found.du, du, found.dv * dv)));
    store_some(row.seen + place, count, keep(here.inside, channel(own, k) * (1.0f / 255.0f)));
  }
  store_some(row.known + first, count, keep(here.inside, splat(1.0f)));
}

// There and back: the neighbour's surface point Y in the view's axes, and how far from the pixel it is seen. Returns the
// sum of w·e.
GOC_INLINE Lanes go_back(const PairRow& row, const Landing& at, Lanes px, float py, int first, int count) {
  const float* m = row.from_view;
  const Lens& lens = row.lens;
  const Lanes far = splat(1.0f) / at.inverse;
  const Lanes tx = at.x * far - m[3], ty = at.y * far - m[7], tz = far - m[11];
  Lanes back[3];
  for (int k = 0; k < 3; ++k) back[k] = fma(tx, m[k], fma(ty, m[4 + k], tz * m[8 + k]));
  const Lanes near = splat(1.0f) / back[2];
  const Lanes ex = back[0] * near * lens.fx + lens.cx - px, ey = back[1] * near * lens.fy + (lens.cy - py);
  const Lanes error = sqrt(fma(ex, ex, ey * ey));
  const Mask one = at.smooth & (back[2] > splat(0.0f)) & (splat(kMaxError) > error);
  // The weight says how likely both are one surface; it is not optimised.
  const Lanes weight = exp2(keep(one, error) * -kLog2E);
  const Mask pulls = one & (error > splat(0.0f));
  const Lanes share = weight / error * near;
  const Lanes gx = ex * share * lens.fx, gy = ey * share * lens.fy;
  const Lanes gz = splat(0.0f) - (gx * back[0] + gy * back[1]) * near;
  Lanes pull[3];  // of w·e by Y
  for (int k = 0; k < 3; ++k) pull[k] = fma(gx, m[4 * k], fma(gy, m[4 * k + 1], gz * m[4 * k + 2]));
  const Lanes by_inverse = splat(0.0f) - fma(pull[0], at.x, fma(pull[1], at.y, pull[2])) * far * far;
  const Lanes grad = fma(fma(pull[0], at.dx, pull[1] * at.dy), far, by_inverse * at.d_inverse);
  store_some(row.geometric_grad + first, count, keep(pulls, grad));
  if (row.pulls) {
    store_some(row.pulls + first, count, at.u), store_some(row.pulls + row.plane + first, count, at.v);
    store_some(row.pulls + 2 * row.plane + first, count, keep(pulls, by_inverse));
  }
  return keep(one, weight * error);
}

}  // namespace

void pair_row(const PairRow& row, float* error, int* smooth) {
  const float* m = row.from_view;
  const Lens& lens = row.lens;
  const float py = (float)row.y + 0.5f, ry = (py - lens.cy) / lens.fy;
  Lanes total = splat(0.0f);
  *smooth = 0;
  for (int first = 0; first < lens.width; first += 16) {
    const int count = lens.width - first < 16 ? lens.width - first : 16;
    const Lanes numerator = load_some(row.numerator + first, count);
    const Lanes denominator = load_some(row.denominator + first, count);
    const Mask rendered = (load_some(row.alpha + first, count) > splat(kMinAlpha)) &
                          (denominator > splat(kMinDenominator)) & (numerator > splat(0.0f));
    const Lanes depth = keep(rendered, numerator / denominator);
    const Lanes px = load(kIota) + (first + 0.5f), rx = (px - lens.cx) * (1.0f / lens.fx);
    Lanes ray[3];
    for (int k = 0; k < 3; ++k) ray[k] = fma(rx, m[4 * k], splat(m[4 * k + 1] * ry + m[4 * k + 2]));
    const Landing at = land(row, ray, depth, rendered);
    store_some(row.depth + first, count, depth);
    // Hidden behind what the neighbour sees: its photograph shows something else.
    if (row.warped) fetch_colours(row, at, at.known & (at.z * at.inverse <= 1 + row.tolerance), first, count);
    if (!row.geometric_grad) continue;
    *smooth += __builtin_popcount(bits(at.smooth));
    total = total + go_back(row, at, px, py, first, count);
  }
  *error = sum(total);
}

}  // namespace goc::GOC_ISA
