// Between arrays with one row a splat and sixteen splats side by side.
#pragma once
#include "raster.hpp"

namespace goc {

// Splats first … first + count − 1, at most sixteen; further lanes repeat the first.
void read_lanes(const SplatArrays& splats, std::size_t first, int count, SplatLanes& out);
// Writes `count` rows of gradients, zeros where a bit of `visible` is not set.
void write_lanes(const SplatLanes& lanes, std::size_t first, int count, std::uint32_t visible,
                 const SplatGradients& out);

// Writes the channels.count() channels of splat i, which is in this lane. harmonics: of every lane.
void fill_channels(const Channels& channels, std::size_t i, int lane, const ProjectedLanes& projected,
                   const float (*harmonics)[16], float* out);
// Their gradient: to splat i's row of `out`, and to the lane of `projected`.
void channels_backward(const Channels& channels, std::size_t i, int lane, const float* values, const float* grad,
                       const float (*harmonics)[16], const ChannelGradients& out, ProjectedLanes& projected);
// That of a splat out of view.
void clear_channels(const Channels& channels, std::size_t i, const ChannelGradients& out);

}  // namespace goc
