// Projection of a splat to the image plane and its gradient.
#include <algorithm>
#include <cmath>

#include "project.hpp"

namespace goc {
namespace {

constexpr float kLog2E = 1.4426950408889634f;

void rotation_of(const float q_in[4], float r[9]) {
  const float norm = 1.0f / std::sqrt(q_in[0] * q_in[0] + q_in[1] * q_in[1] + q_in[2] * q_in[2] + q_in[3] * q_in[3]);
  const float w = q_in[0] * norm, x = q_in[1] * norm, y = q_in[2] * norm, z = q_in[3] * norm;
  r[0] = 1 - 2 * (y * y + z * z), r[1] = 2 * (x * y - w * z), r[2] = 2 * (x * z + w * y);
  r[3] = 2 * (x * y + w * z), r[4] = 1 - 2 * (x * x + z * z), r[5] = 2 * (y * z - w * x);
  r[6] = 2 * (x * z - w * y), r[7] = 2 * (y * z + w * x), r[8] = 1 - 2 * (x * x + y * y);
}

}  // namespace

bool see(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, Seen& s) {
  const float* m = splats.means + 3 * i;
  const float* view = camera.view;
  for (int k = 0; k < 3; ++k)
    s.t[k] = view[4 * k] * m[0] + view[4 * k + 1] * m[1] + view[4 * k + 2] * m[2] + view[4 * k + 3];
  if (!(s.t[2] > kNear)) return false;
  s.opacity = 1.0f / (1.0f + std::exp(-splats.opacity_logits[i]));
  if (!(s.opacity >= kMinAlpha)) return false;
  rotation_of(splats.quats + 4 * i, s.rotation);
  for (int k = 0; k < 3; ++k) s.scale[k] = std::exp(splats.log_scales[3 * i + k]);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) {
      float sum = 0;
      for (int k = 0; k < 3; ++k) sum += view[4 * row + k] * s.rotation[3 * k + column];
      s.v[3 * row + column] = sum * s.scale[column];
    }
  // The affine approximation is held within 1.3 times the field of view, as in 3D Gaussian Splatting.
  const float inverse_z = 1.0f / s.t[2];
  const float tan_x = 0.5f * camera.width / camera.fx, tan_y = 0.5f * camera.height / camera.fy;
  const float x = s.t[0] * inverse_z, y = s.t[1] * inverse_z;
  const float bound_x = std::clamp(x, -(camera.cx / camera.fx + 0.3f * tan_x),
                                   (camera.width - camera.cx) / camera.fx + 0.3f * tan_x);
  const float bound_y = std::clamp(y, -(camera.cy / camera.fy + 0.3f * tan_y),
                                   (camera.height - camera.cy) / camera.fy + 0.3f * tan_y);
  s.clamped_x = bound_x != x, s.clamped_y = bound_y != y;
  s.j00 = camera.fx * inverse_z, s.j02 = -camera.fx * bound_x * inverse_z;
  s.j11 = camera.fy * inverse_z, s.j12 = -camera.fy * bound_y * inverse_z;
  for (int k = 0; k < 3; ++k) {
    s.p[k] = s.j00 * s.v[k] + s.j02 * s.v[6 + k];
    s.p[3 + k] = s.j11 * s.v[3 + k] + s.j12 * s.v[6 + k];
  }
  s.xx = s.p[0] * s.p[0] + s.p[1] * s.p[1] + s.p[2] * s.p[2] + kDilation;
  s.xy = s.p[0] * s.p[3] + s.p[1] * s.p[4] + s.p[2] * s.p[5];
  s.yy = s.p[3] * s.p[3] + s.p[4] * s.p[4] + s.p[5] * s.p[5] + kDilation;
  return s.xx * s.yy - s.xy * s.xy > 0;
}

bool project(const Seen& s, const RasterCamera& camera, Splat2D& out, float reach[2]) {
  const float inverse_det = 1.0f / (s.xx * s.yy - s.xy * s.xy);
  out.x = camera.fx * s.t[0] / s.t[2] + camera.cx;
  out.y = camera.fy * s.t[1] / s.t[2] + camera.cy;
  out.a = 0.5f * kLog2E * s.yy * inverse_det;
  out.b = -kLog2E * s.xy * inverse_det;
  out.c = 0.5f * kLog2E * s.xx * inverse_det;
  out.log2_opacity = std::log2(s.opacity);
  out.depth = s.t[2];
  out.unused = 0;
  const float mahalanobis2 = 2.0f * (out.log2_opacity + kLog2Of255) / kLog2E;
  reach[0] = std::sqrt(mahalanobis2 * s.xx);
  reach[1] = std::sqrt(mahalanobis2 * s.yy);
  return std::isfinite(out.x) && std::isfinite(out.y) && std::isfinite(reach[0]) && std::isfinite(reach[1]);
}

namespace {

// dL/dq of an unnormalised quaternion from dL/dR, through the normalisation.
void rotation_backward(const float q_in[4], const float g[9], float out[4]) {
  const float length = std::sqrt(q_in[0] * q_in[0] + q_in[1] * q_in[1] + q_in[2] * q_in[2] + q_in[3] * q_in[3]);
  const float w = q_in[0] / length, x = q_in[1] / length, y = q_in[2] / length, z = q_in[3] / length;
  const float gw = 2 * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]));
  const float gx = 2 * (-2 * x * (g[4] + g[8]) + y * (g[1] + g[3]) + z * (g[2] + g[6]) + w * (g[7] - g[5]));
  const float gy = 2 * (x * (g[1] + g[3]) - 2 * y * (g[0] + g[8]) + z * (g[5] + g[7]) + w * (g[2] - g[6]));
  const float gz = 2 * (x * (g[2] + g[6]) + y * (g[5] + g[7]) - 2 * z * (g[0] + g[4]) + w * (g[3] - g[1]));
  const float along = gw * w + gx * x + gy * y + gz * z;
  out[0] = (gw - along * w) / length, out[1] = (gx - along * x) / length;
  out[2] = (gy - along * y) / length, out[3] = (gz - along * z) / length;
}

}  // namespace

void project_backward(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, const Seen& s,
                      const Splat2D& projected, const float grad[6], const Pull& pull, const SplatGradients& out) {
  // log2_alpha = log2_opacity − a dx² − b dx dy − c dy²
  const float gx = 2 * projected.a * grad[1] + projected.b * grad[2];
  const float gy = projected.b * grad[1] + 2 * projected.c * grad[2];
  out.opacity_logits[i] = grad[0] * kLog2E * (1.0f - s.opacity);
  // Gradient of the inverse covariance Q, then of the covariance: −Q G Q.
  const float qa = 2 * projected.a / kLog2E, qb = projected.b / kLog2E, qc = 2 * projected.c / kLog2E;
  const float h = -0.5f * kLog2E;
  const float g00 = h * grad[3], g01 = h * grad[4], g11 = h * grad[5];
  const float m00 = qa * g00 + qb * g01, m01 = qa * g01 + qb * g11;
  const float m10 = qb * g00 + qc * g01, m11 = qb * g01 + qc * g11;
  const float c00 = -(m00 * qa + m01 * qb), c01 = -(m00 * qb + m01 * qc), c11 = -(m10 * qb + m11 * qc);
  // Covariance = P Pᵀ + dilation, P = J V.
  float gp[6];
  for (int k = 0; k < 3; ++k) {
    gp[k] = 2 * (c00 * s.p[k] + c01 * s.p[3 + k]);
    gp[3 + k] = 2 * (c01 * s.p[k] + c11 * s.p[3 + k]);
  }
  float j00 = 0, j02 = 0, j11 = 0, j12 = 0, gv[9];
  for (int k = 0; k < 3; ++k) {
    j00 += gp[k] * s.v[k], j02 += gp[k] * s.v[6 + k];
    j11 += gp[3 + k] * s.v[3 + k], j12 += gp[3 + k] * s.v[6 + k];
    gv[k] = s.j00 * gp[k];
    gv[3 + k] = s.j11 * gp[3 + k];
    gv[6 + k] = s.j02 * gp[k] + s.j12 * gp[3 + k];
  }
  float gr[9];
  float* scale_grad = out.log_scales + 3 * i;
  scale_grad[0] = scale_grad[1] = scale_grad[2] = 0;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) {
      const float gm = camera.view[row] * gv[column] + camera.view[4 + row] * gv[3 + column] +
                       camera.view[8 + row] * gv[6 + column];
      gr[3 * row + column] = gm * s.scale[column] + pull.rotation[3 * row + column];
      scale_grad[column] += gm * s.rotation[3 * row + column] * s.scale[column];
    }
  rotation_backward(splats.quats + 4 * i, gr, out.quats + 4 * i);
  // Centre: through its image position, and through J. Where J is clamped, it depends on z alone.
  const float z = s.t[2], inverse_z = 1 / z;
  float gt[3];
  gt[0] = gx * camera.fx * inverse_z + (s.clamped_x ? 0 : -j02 * camera.fx * inverse_z * inverse_z);
  gt[1] = gy * camera.fy * inverse_z + (s.clamped_y ? 0 : -j12 * camera.fy * inverse_z * inverse_z);
  gt[2] = -(gx * camera.fx * s.t[0] + gy * camera.fy * s.t[1]) * inverse_z * inverse_z -
          (j00 * s.j00 + j11 * s.j11) * inverse_z - j02 * s.j02 * inverse_z * (s.clamped_x ? 1 : 2) -
          j12 * s.j12 * inverse_z * (s.clamped_y ? 1 : 2);
  for (int k = 0; k < 3; ++k) gt[k] += pull.centre[k];
  for (int k = 0; k < 3; ++k)
    out.means[3 * i + k] = camera.view[k] * gt[0] + camera.view[4 + k] * gt[1] + camera.view[8 + k] * gt[2];
}

}  // namespace goc
