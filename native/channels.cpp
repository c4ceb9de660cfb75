// What a training view blends, splat by splat: colour by spherical harmonics, the splat's plane or depth, features.
#include <cmath>
#include <cstring>

#include "project.hpp"

namespace goc {
namespace {

// Real spherical harmonics up to degree 3, as src/goc/geometry/harmonics.py.
void harmonics(const float d[3], int count, float* out) {
  const float x = d[0], y = d[1], z = d[2];
  out[0] = 0.28209479177387814f;
  if (count < 4) return;
  out[1] = -0.4886025119029199f * y, out[2] = 0.4886025119029199f * z, out[3] = -0.4886025119029199f * x;
  if (count < 9) return;
  const float xx = x * x, yy = y * y, zz = z * z;
  out[4] = 1.0925484305920792f * x * y, out[5] = -1.0925484305920792f * y * z;
  out[6] = 0.31539156525252005f * (2 * zz - xx - yy);
  out[7] = -1.0925484305920792f * x * z, out[8] = 0.5462742152960396f * (xx - yy);
  if (count < 16) return;
  out[9] = -0.5900435899266435f * y * (3 * xx - yy), out[10] = 2.890611442640554f * x * y * z;
  out[11] = -0.4570457994644658f * y * (4 * zz - xx - yy);
  out[12] = 0.3731763325901154f * z * (2 * zz - 3 * xx - 3 * yy);
  out[13] = -0.4570457994644658f * x * (4 * zz - xx - yy), out[14] = 1.445305721320277f * z * (xx - yy);
  out[15] = -0.5900435899266435f * x * (xx - 3 * yy);
}

void basis_of(const Channels& channels, const SplatArrays& splats, std::size_t i, float* out) {
  const float* mean = splats.means + 3 * i;
  const float x = mean[0] - channels.eye[0], y = mean[1] - channels.eye[1], z = mean[2] - channels.eye[2];
  const float inverse = 1.0f / std::fmax(std::sqrt(x * x + y * y + z * z), 1e-12f);
  const float direction[3] = {x * inverse, y * inverse, z * inverse};
  harmonics(direction, channels.harmonics, out);
}

// The thinnest axis, and its direction in camera axes, turned towards the camera.
struct Plane {
  int axis;
  float sign, normal[3], distance;
};
Plane plane_of(const SplatArrays& splats, std::size_t i, const RasterCamera& camera, const Seen& seen) {
  const float* size = splats.log_scales + 3 * i;
  Plane plane{};
  for (int k = 1; k < 3; ++k)
    if (size[k] < size[plane.axis]) plane.axis = k;
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < 3; ++k) plane.normal[row] += camera.view[4 * row + k] * seen.rotation[3 * k + plane.axis];
    plane.distance += plane.normal[row] * seen.t[row];
  }
  // A plane before the camera that faces it has n·centre < 0.
  plane.sign = plane.distance > 0 ? -1.0f : 1.0f;
  for (float& n : plane.normal) n *= plane.sign;
  plane.distance *= plane.sign;
  return plane;
}

}  // namespace

void fill_channels(const Channels& channels, const SplatArrays& splats, std::size_t i, const RasterCamera& camera,
                   const Seen& seen, float* out) {
  if (channels.sh) {
    float basis[16];
    basis_of(channels, splats, i, basis);
    const float* sh = channels.sh + 3 * channels.harmonics * i;
    float colour[3] = {0.5f, 0.5f, 0.5f};
    for (int k = 0; k < channels.harmonics; ++k)
      for (int c = 0; c < 3; ++c) colour[c] += basis[k] * sh[3 * k + c];
    for (int c = 0; c < 3; ++c) *out++ = colour[c] < 0.0f ? 0.0f : colour[c];
    if (channels.planes) {
      const Plane plane = plane_of(splats, i, camera, seen);
      std::memcpy(out, plane.normal, sizeof plane.normal);
      out[3] = plane.distance;
      out += 4;
    } else {
      *out++ = seen.t[2];
    }
  }
  if (channels.features) std::memcpy(out, channels.features + i * channels.feature_count, channels.feature_count * 4);
}

void channels_backward(const Channels& channels, const SplatArrays& splats, std::size_t i, const RasterCamera& camera,
                       const Seen& seen, const float* values, const float* grad, const ChannelGradients& out,
                       Pull& pull) {
  if (channels.sh) {
    float basis[16];
    basis_of(channels, splats, i, basis);
    float* sh = out.sh + 3 * channels.harmonics * i;
    for (int k = 0; k < channels.harmonics; ++k)
      for (int c = 0; c < 3; ++c) sh[3 * k + c] = values[c] > 0.0f ? basis[k] * grad[c] : 0.0f;
    values += 3, grad += 3;
    if (channels.planes) {
      const Plane plane = plane_of(splats, i, camera, seen);
      float along[3];  // gradient of the unsigned normal
      for (int row = 0; row < 3; ++row) {
        along[row] = plane.sign * (grad[row] + grad[3] * seen.t[row]);
        pull.centre[row] += grad[3] * plane.normal[row];
      }
      for (int k = 0; k < 3; ++k)
        for (int row = 0; row < 3; ++row) pull.rotation[3 * k + plane.axis] += camera.view[4 * row + k] * along[row];
      values += 4, grad += 4;
    } else {
      pull.centre[2] += grad[0];
      ++values, ++grad;
    }
  }
  if (out.features) std::memcpy(out.features + i * channels.feature_count, grad, channels.feature_count * 4);
}

}  // namespace goc
