// Projection of sixteen splats, one a lane, to the image plane (Zwicker et al. 2001), what a training view blends of
// them, and the gradient of both.
#include "kernels.hpp"
#include "powers.hpp"

namespace goc::GOC_ISA {
namespace {

constexpr float kLog2E = 1.4426950408889634f;
alignas(64) const float kBlockX[16] = {0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12};
alignas(64) const float kBlockY[16] = {0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12};
static_assert(kBlock == 4 && kTile == 16);

GOC_INLINE Lanes negated(Lanes x) { return splat(0.0f) - x; }
GOC_INLINE Lanes dot(const Lanes* a, const Lanes* b) { return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2])); }
GOC_INLINE Mask finite(Lanes x) { return x - x == splat(0.0f); }

// How a splat is seen: V = cam_from_splat axes · scales, J the Jacobian of the projection, P = J V.
struct Seen {
  Lanes t[3];         // centre, camera axes
  Lanes length, unit[4];
  Lanes rotation[9];  // world from splat, row-major
  Lanes scale[3], v[9];
  Lanes inverse_z, j00, j02, j11, j12;
  Mask free_x, free_y;  // J is not clamped
  Lanes p[6];           // 2×3
  Lanes opacity;
  Lanes xx, xy, yy;     // covariance on the image plane, px²
};

GOC_INLINE void rotate(Seen& s) {
  const Lanes w = s.unit[0], x = s.unit[1], y = s.unit[2], z = s.unit[3];
  Lanes* r = s.rotation;
  r[0] = 1.0f - (y * y + z * z) * 2.0f, r[1] = (x * y - w * z) * 2.0f, r[2] = (x * z + w * y) * 2.0f;
  r[3] = (x * y + w * z) * 2.0f, r[4] = 1.0f - (x * x + z * z) * 2.0f, r[5] = (y * z - w * x) * 2.0f;
  r[6] = (x * z - w * y) * 2.0f, r[7] = (y * z + w * x) * 2.0f, r[8] = 1.0f - (x * x + y * y) * 2.0f;
}

void see(const SplatLanes& in, const DrawCamera& camera, Seen& s) {
  const float* view = camera.cam_from_world;
  Lanes mean[3];
  for (int k = 0; k < 3; ++k) mean[k] = load(in.mean[k]);
  for (int k = 0; k < 3; ++k)
    s.t[k] = fma(mean[0], view[4 * k], fma(mean[1], view[4 * k + 1], mean[2] * view[4 * k + 2])) + view[4 * k + 3];
  s.opacity = splat(1.0f) / (exp2(load(in.opacity_logit) * -kLog2E) + 1.0f);
  Lanes squared = splat(0.0f);
  for (int k = 0; k < 4; ++k) squared = fma(load(in.quat[k]), load(in.quat[k]), squared);
  s.length = sqrt(squared);
  const Lanes inverse_length = splat(1.0f) / s.length;
  for (int k = 0; k < 4; ++k) s.unit[k] = load(in.quat[k]) * inverse_length;
  rotate(s);
  for (int k = 0; k < 3; ++k) s.scale[k] = exp2(load(in.log_scale[k]) * kLog2E);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      s.v[3 * row + column] =
          fma(s.rotation[column], view[4 * row],
              fma(s.rotation[3 + column], view[4 * row + 1], s.rotation[6 + column] * view[4 * row + 2])) *
          s.scale[column];
  // The affine approximation is held within 1.3 times the field of view, as in 3D Gaussian Splatting.
  const float margin_x = 0.15f * camera.width / camera.fx, margin_y = 0.15f * camera.height / camera.fy;
  s.inverse_z = splat(1.0f) / s.t[2];
  const Lanes x = s.t[0] * s.inverse_z, y = s.t[1] * s.inverse_z;
  const Lanes bound_x = min(max(x, splat(-(camera.cx / camera.fx + margin_x))),
                            splat((camera.width - camera.cx) / camera.fx + margin_x));
  const Lanes bound_y = min(max(y, splat(-(camera.cy / camera.fy + margin_y))),
                            splat((camera.height - camera.cy) / camera.fy + margin_y));
  s.free_x = bound_x == x, s.free_y = bound_y == y;
  s.j00 = s.inverse_z * camera.fx, s.j02 = negated(s.j00 * bound_x);
  s.j11 = s.inverse_z * camera.fy, s.j12 = negated(s.j11 * bound_y);
  for (int k = 0; k < 3; ++k) {
    s.p[k] = fma(s.j00, s.v[k], s.j02 * s.v[6 + k]);
    s.p[3 + k] = fma(s.j11, s.v[3 + k], s.j12 * s.v[6 + k]);
  }
  s.xx = dot(s.p, s.p) + kDilation;
  s.xy = dot(s.p, s.p + 3);
  s.yy = dot(s.p + 3, s.p + 3) + kDilation;
}

// The thinnest axis, and its direction in camera axes, turned towards the camera.
struct Plane {
  Mask is_axis[3];
  Lanes sign, normal[3], distance;
};
GOC_INLINE void plane_of(const SplatLanes& in, const DrawCamera& camera, const Seen& s, Plane& plane) {
  const Lanes a = load(in.log_scale[0]), b = load(in.log_scale[1]), c = load(in.log_scale[2]);
  const Lanes first = min(a, b);
  plane.is_axis[2] = first > c;
  plane.is_axis[1] = (a > b) & (c >= first);
  plane.is_axis[0] = (b >= a) & (c >= first);
  Lanes axis[3];  // world
  for (int k = 0; k < 3; ++k)
    axis[k] = select(plane.is_axis[2], s.rotation[3 * k + 2],
                     select(plane.is_axis[1], s.rotation[3 * k + 1], s.rotation[3 * k]));
  const float* view = camera.cam_from_world;
  for (int row = 0; row < 3; ++row)
    plane.normal[row] = fma(axis[0], view[4 * row], fma(axis[1], view[4 * row + 1], axis[2] * view[4 * row + 2]));
  plane.distance = dot(plane.normal, s.t);
  // A plane before the camera that faces it has n·centre < 0.
  plane.sign = select(plane.distance > splat(0.0f), splat(-1.0f), splat(1.0f));
  for (int row = 0; row < 3; ++row) plane.normal[row] = plane.normal[row] * plane.sign;
  plane.distance = plane.distance * plane.sign;
}

// Exact: the least of a convex quadratic over a rectangle lies at the centre, or on one of the two edges that face it.
// On an edge it is a parabola, so its least point is known; both candidates lie in the rectangle, so the lesser is it.
GOC_INLINE std::uint16_t touched(const Splat2D& s, float slope_x, float slope_y, int x, int y) {
  const Lanes left = load(kBlockX) + (x + 0.5f - s.x), top = load(kBlockY) + (y + 0.5f - s.y);
  const Lanes right = left + (kBlock - 1.0f), bottom = top + (kBlock - 1.0f);
  const Lanes zero = splat(0.0f);
  const Lanes edge_x = min(max(zero, left), right), edge_y = min(max(zero, top), bottom);
  const Lanes best_y = min(max(edge_x * slope_y, top), bottom);
  const Lanes best_x = min(max(edge_y * slope_x, left), right);
  const Lanes on_x = fma(edge_x, fma(edge_x, s.a, best_y * s.b), best_y * best_y * s.c);
  const Lanes on_y = fma(best_x, fma(best_x, s.a, edge_y * s.b), edge_y * edge_y * s.c);
  return (std::uint16_t)bits(min(on_x, on_y) <= s.log2_opacity + kLog2Of255);
}

// The blocks that [x − reach, x + reach] pixels meet, of a side that has whole tiles of them; whether there are any.
GOC_INLINE Mask span(Lanes x, Lanes reach, int pixels, std::int32_t* first, std::int32_t* last) {
  const Lanes zero = splat(0.0f), end = splat((float)((pixels + kTile - 1) / kTile * (kTile / kBlock)));
  const IntLanes from = truncate(min(max((x - reach - 0.5f) * (1.0f / kBlock), zero), end));
  const IntLanes to = truncate(min(max((x + reach - 0.5f) * (1.0f / kBlock) + 1.0f, zero), end));
  store(first, from), store(last, to);
  return ~(from >= to);
}

}  // namespace

void harmonics_lanes(const SplatLanes& in, const float* eye, int count, float (*out)[16]) {
  Lanes d[3];
  for (int k = 0; k < 3; ++k) d[k] = load(in.mean[k]) - eye[k];
  const Lanes inverse = splat(1.0f) / max(sqrt(dot(d, d)), splat(1e-12f));
  const Lanes x = d[0] * inverse, y = d[1] * inverse, z = d[2] * inverse;
  // Real spherical harmonics up to degree 3, as src/goc/geometry/harmonics.py.
  store(out[0], splat(0.28209479177387814f));
  if (count < 4) return;
  store(out[1], y * -0.4886025119029199f), store(out[2], z * 0.4886025119029199f);
  store(out[3], x * -0.4886025119029199f);
  if (count < 9) return;
  const Lanes xx = x * x, yy = y * y, zz = z * z;
  store(out[4], x * y * 1.0925484305920792f), store(out[5], y * z * -1.0925484305920792f);
  store(out[6], (zz * 2.0f - xx - yy) * 0.31539156525252005f);
  store(out[7], x * z * -1.0925484305920792f), store(out[8], (xx - yy) * 0.5462742152960396f);
  if (count < 16) return;
  store(out[9], y * (xx * 3.0f - yy) * -0.5900435899266435f), store(out[10], x * y * z * 2.890611442640554f);
  store(out[11], y * (zz * 4.0f - xx - yy) * -0.4570457994644658f);
  store(out[12], z * (zz * 2.0f - xx * 3.0f - yy * 3.0f) * 0.3731763325901154f);
  store(out[13], x * (zz * 4.0f - xx - yy) * -0.4570457994644658f);
  store(out[14], z * (xx - yy) * 1.445305721320277f);
  store(out[15], x * (xx - yy * 3.0f) * -0.5900435899266435f);
}

std::uint16_t touched_blocks(const Splat2D& splat, float slope_x, float slope_y, int x, int y) {
  return touched(splat, slope_x, slope_y, x, y);
}

std::uint32_t project_lanes(const SplatLanes& in, const DrawCamera& camera, bool planes, ProjectedLanes& out,
                            Footprints& footprints) {
  Seen s;
  see(in, camera, s);
  const Lanes det = s.xx * s.yy - s.xy * s.xy, inverse_det = splat(1.0f) / det;
  const Lanes x = s.t[0] * s.inverse_z * camera.fx + camera.cx, y = s.t[1] * s.inverse_z * camera.fy + camera.cy;
  const Lanes log2_opacity = log2(s.opacity);
  store(out.splat[0], x), store(out.splat[1], y);
  store(out.splat[2], s.yy * inverse_det * (0.5f * kLog2E));
  store(out.splat[3], s.xy * inverse_det * -kLog2E);
  store(out.splat[4], s.xx * inverse_det * (0.5f * kLog2E));
  store(out.splat[5], log2_opacity), store(out.splat[6], s.t[2]), store(out.splat[7], splat(0.0f));
  if (planes) {
    Plane plane;
    plane_of(in, camera, s, plane);
    for (int k = 0; k < 3; ++k) store(out.plane[k], plane.normal[k]);
    store(out.plane[3], plane.distance);
  }
  // Half the box of {alpha ≥ 1/255}.
  const Lanes mahalanobis2 = (log2_opacity + kLog2Of255) * (2.0f / kLog2E);
  const Lanes reach_x = sqrt(mahalanobis2 * s.xx), reach_y = sqrt(mahalanobis2 * s.yy);
  const Mask seen = (s.t[2] > splat(kNear)) & (s.opacity >= kMinAlpha) & (det > splat(0.0f)) & finite(x) & finite(y) &
                    finite(reach_x) & finite(reach_y);
  store(footprints.slope_x, s.xy / s.yy), store(footprints.slope_y, s.xy / s.xx);
  const Mask in_image = span(keep(seen, x), reach_x, camera.width, footprints.first_x, footprints.last_x) &
                        span(keep(seen, y), reach_y, camera.height, footprints.first_y, footprints.last_y);
  const std::uint32_t found = bits(seen & in_image);
  for (std::uint32_t rest = found; rest; rest &= rest - 1) {
    const int l = __builtin_ctz(rest);
    const Splat2D one{out.splat[0][l], out.splat[1][l], out.splat[2][l], out.splat[3][l], out.splat[4][l],
                      out.splat[5][l], 0.0f, 0.0f};
    footprints.window[l] = touched(one, footprints.slope_x[l], footprints.slope_y[l], footprints.first_x[l] * kBlock,
                                   footprints.first_y[l] * kBlock);
  }
  return found;
}

void project_lanes_backward(const SplatLanes& in, const DrawCamera& camera, const ProjectedLanes& grad, bool planes,
                            bool depths, SplatLanes& out) {
  const float* view = camera.cam_from_world;
  Seen s;
  see(in, camera, s);
  const Lanes inverse_det = splat(1.0f) / (s.xx * s.yy - s.xy * s.xy);
  // The inverse covariance Q; ln alpha = ln opacity − ½ dᵀ Q d.
  const Lanes qa = s.yy * inverse_det, qb = negated(s.xy * inverse_det), qc = s.xx * inverse_det;
  const Lanes sum_x = load(grad.splat[1]), sum_y = load(grad.splat[2]);
  const Lanes gx = fma(qa, sum_x, qb * sum_y), gy = fma(qb, sum_x, qc * sum_y);
  store(out.opacity_logit, load(grad.splat[0]) * (1.0f - s.opacity));
  // Gradient of Q, then of the covariance: −Q G Q.
  const Lanes g00 = load(grad.splat[3]) * -0.5f, g01 = load(grad.splat[4]) * -0.5f;
  const Lanes g11 = load(grad.splat[5]) * -0.5f;
  const Lanes m00 = fma(qa, g00, qb * g01), m01 = fma(qa, g01, qb * g11);
  const Lanes m10 = fma(qb, g00, qc * g01), m11 = fma(qb, g01, qc * g11);
  const Lanes c00 = fma(m00, qa, m01 * qb) * -2.0f, c01 = fma(m00, qb, m01 * qc) * -2.0f;
  const Lanes c11 = fma(m10, qb, m11 * qc) * -2.0f;
  // Covariance = P Pᵀ + dilation, P = J V.
  Lanes gp[6], gv[9];
  for (int k = 0; k < 3; ++k) {
    gp[k] = fma(c00, s.p[k], c01 * s.p[3 + k]);
    gp[3 + k] = fma(c01, s.p[k], c11 * s.p[3 + k]);
    gv[k] = s.j00 * gp[k];
    gv[3 + k] = s.j11 * gp[3 + k];
    gv[6 + k] = fma(s.j02, gp[k], s.j12 * gp[3 + k]);
  }
  const Lanes j00 = dot(gp, s.v), j02 = dot(gp, s.v + 6), j11 = dot(gp + 3, s.v + 3), j12 = dot(gp + 3, s.v + 6);
  Lanes gr[9], scale_grad[3] = {splat(0.0f), splat(0.0f), splat(0.0f)};
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) {
      const Lanes g = fma(gv[column], view[row], fma(gv[3 + column], view[4 + row], gv[6 + column] * view[8 + row])) *
                      s.scale[column];
      gr[3 * row + column] = g;
      scale_grad[column] = fma(g, s.rotation[3 * row + column], scale_grad[column]);
    }
  for (int k = 0; k < 3; ++k) store(out.log_scale[k], scale_grad[k]);
  // Centre: through its image position, and through J. Where J is clamped, it depends on z alone.
  const Lanes iz = s.inverse_z, iz2 = iz * iz;
  Lanes gt[3];
  gt[0] = gx * camera.fx * iz - keep(s.free_x, j02 * camera.fx * iz2);
  gt[1] = gy * camera.fy * iz - keep(s.free_y, j12 * camera.fy * iz2);
  gt[2] = negated(fma(gx * camera.fx, s.t[0], gy * camera.fy * s.t[1]) * iz2 + fma(j00, s.j00, j11 * s.j11) * iz +
                  j02 * s.j02 * iz * select(s.free_x, splat(2.0f), splat(1.0f)) +
                  j12 * s.j12 * iz * select(s.free_y, splat(2.0f), splat(1.0f)));
  if (planes) {
    Plane plane;
    plane_of(in, camera, s, plane);
    const Lanes g_distance = load(grad.plane[3]);
    Lanes along[3];  // gradient of the unsigned normal
    for (int row = 0; row < 3; ++row) {
      along[row] = plane.sign * fma(g_distance, s.t[row], load(grad.plane[row]));
      gt[row] = fma(g_distance, plane.normal[row], gt[row]);
    }
    for (int row = 0; row < 3; ++row) {
      const Lanes g = fma(along[0], view[row], fma(along[1], view[4 + row], along[2] * view[8 + row]));
      for (int k = 0; k < 3; ++k) gr[3 * row + k] = gr[3 * row + k] + keep(plane.is_axis[k], g);
    }
  }
  if (depths) gt[2] = gt[2] + load(grad.plane[0]);
  for (int k = 0; k < 3; ++k)
    store(out.mean[k], fma(gt[0], view[k], fma(gt[1], view[4 + k], gt[2] * view[8 + k])));
  // dL/dq of an unnormalised quaternion from dL/dR, through the normalisation.
  const Lanes w = s.unit[0], x = s.unit[1], y = s.unit[2], z = s.unit[3];
  Lanes gq[4];
  gq[0] = x * (gr[7] - gr[5]) + y * (gr[2] - gr[6]) + z * (gr[3] - gr[1]);
  gq[1] = x * (gr[4] + gr[8]) * -2.0f + y * (gr[1] + gr[3]) + z * (gr[2] + gr[6]) + w * (gr[7] - gr[5]);
  gq[2] = x * (gr[1] + gr[3]) - y * (gr[0] + gr[8]) * 2.0f + z * (gr[5] + gr[7]) + w * (gr[2] - gr[6]);
  gq[3] = x * (gr[2] + gr[6]) + y * (gr[5] + gr[7]) - z * (gr[0] + gr[4]) * 2.0f + w * (gr[3] - gr[1]);
  Lanes inward = splat(0.0f);
  for (int k = 0; k < 4; ++k) inward = fma(gq[k], s.unit[k], inward);
  const Lanes factor = splat(2.0f) / s.length;
  for (int k = 0; k < 4; ++k) store(out.quat[k], (gq[k] - inward * s.unit[k]) * factor);
}

}  // namespace goc::GOC_ISA
