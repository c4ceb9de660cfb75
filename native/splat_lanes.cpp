#include "splat_lanes.hpp"

#include <algorithm>
#include <cstring>

namespace goc {
namespace {

template <int kWidth>
void read(const float* rows, std::size_t first, int count, float (*out)[16]) {
  const float* from = rows + first * kWidth;
  for (int l = 0; l < 16; ++l, from += l < count ? kWidth : 0)
    for (int k = 0; k < kWidth; ++k) out[k][l] = from[k];
}

template <int kWidth>
void write(const float (*lanes)[16], std::size_t first, int count, std::uint32_t visible, float* rows) {
  float* to = rows + first * kWidth;
  for (int l = 0; l < count; ++l, to += kWidth)
    for (int k = 0; k < kWidth; ++k) to[k] = visible >> l & 1 ? lanes[k][l] : 0.0f;
}

}  // namespace

void read_lanes(const SplatArrays& splats, std::size_t first, int count, SplatLanes& out) {
  read<3>(splats.means, first, count, out.mean);
  read<4>(splats.quats, first, count, out.quat);
  read<3>(splats.log_scales, first, count, out.log_scale);
  read<1>(splats.opacity_logits, first, count, &out.opacity_logit);
}

void write_lanes(const SplatLanes& lanes, std::size_t first, int count, std::uint32_t visible,
                 const SplatGradients& out) {
  write<3>(lanes.mean, first, count, visible, out.means);
  write<4>(lanes.quat, first, count, visible, out.quats);
  write<3>(lanes.log_scale, first, count, visible, out.log_scales);
  write<1>(&lanes.opacity_logit, first, count, visible, out.opacity_logits);
}

void fill_channels(const Channels& channels, std::size_t i, int lane, const ProjectedLanes& projected,
                   const float (*harmonics)[16], float* out) {
  if (channels.sh) {
    const float* sh = channels.sh + i * 3 * channels.harmonics;
    float colour[3] = {0.5f, 0.5f, 0.5f};
    for (int k = 0; k < channels.harmonics; ++k)
      for (int c = 0; c < 3; ++c) colour[c] += harmonics[k][lane] * sh[3 * k + c];
    for (int c = 0; c < 3; ++c) *out++ = std::max(colour[c], 0.0f);
    if (channels.planes)
      for (int k = 0; k < 4; ++k) *out++ = projected.plane[k][lane];
    else
      *out++ = projected.splat[6][lane];
  }
  if (channels.features) std::copy_n(channels.features + i * channels.feature_count, channels.feature_count, out);
}

void channels_backward(const Channels& channels, std::size_t i, int lane, const float* values, const float* grad,
                       const float (*harmonics)[16], const ChannelGradients& out, ProjectedLanes& projected) {
  if (channels.sh) {
    float* sh = out.sh + i * 3 * channels.harmonics;
    float colour[3];  // of a colour that was not clamped
    for (int c = 0; c < 3; ++c) colour[c] = values[c] > 0.0f ? grad[c] : 0.0f;
    for (int k = 0; k < channels.harmonics; ++k)
      for (int c = 0; c < 3; ++c) sh[3 * k + c] = harmonics[k][lane] * colour[c];
    const int geometry = channels.planes ? 4 : 1;
    for (int k = 0; k < geometry; ++k) projected.plane[k][lane] = grad[3 + k];
    grad += 3 + geometry;
  }
  if (out.features) std::copy_n(grad, channels.feature_count, out.features + i * channels.feature_count);
}

void clear_channels(const Channels& channels, std::size_t i, const ChannelGradients& out) {
  if (out.sh) std::fill_n(out.sh + i * 3 * channels.harmonics, 3 * channels.harmonics, 0.0f);
  if (out.features) std::fill_n(out.features + i * channels.feature_count, channels.feature_count, 0.0f);
}

}  // namespace goc
