// Depth of posed photographs: a plane sweep smoothed semi-globally, slanted planes that refine it, and a vote of the
// views on what they confirm. Inverse depth throughout: on a plane it is linear in the pixel.
#pragma once
#include <cstdint>
#include <vector>

#include "camera.hpp"

namespace goc {

// Photographs at one scale, each in the upper left corner of one raster.
struct Photos {
  int count, width, height;
  std::vector<float> greys;          // (count, height, width), 0 to 255
  std::vector<std::uint32_t> quads;  // the same as bytes, with those to the right, below and both: one load a sample
  std::vector<Camera> cameras;       // their sizes are what of the raster each photograph fills

  std::size_t pixel(int view, int x, int y) const {
    return (static_cast<std::size_t>(view) * height + y) * width + x;
  }
};

Photos make_photos(const float* greys, std::vector<Camera> cameras, int width, int height);

// Where (x, y) with inverse depth q lands in another photograph: (X, Y, Z) = m·(x, y, 1) + q·t, at (X/Z, Y/Z).
struct Transfer {
  float m[9], t[3];
};
Transfer transfer(const Camera& from, const Camera& to);

// Neighbours of view v are neighbours[v·stride …], -1 = none.
struct Neighbours {
  const int* views;
  int stride;
};

struct SweepSettings {
  int planes;                  // at most, a multiple of 16
  float step_penalty, jump_penalty;  // for neighbours one plane and more planes apart, in units of 1 − ZNCC
};

// Inverse depth of one view's pixels (height, width), and how badly the windows match there in [0, 1].
// Fronto-parallel planes evenly in inverse depth from `far` to `near`; the mean of the three best neighbours' costs
// 1 − ZNCC in windows of 5×5 (Collins 1996; Kang et al. 2001 for the best half), smoothed along eight directions
// (Hirschmüller 2008).
void sweep_view(const Photos& photos, int view, Neighbours neighbours, float far, float near,
                const SweepSettings& settings, float* inverse, float* costs);

struct RefineSettings {
  int sweeps;
  float prior_weight;  // of leaving what the plane sweep found, in units of 1 − ZNCC
  std::uint64_t seed;
};

// Planes (height, width, 3) of one view: inverse depth at the pixel and its slopes along x and y, in and out.
// Each pixel tries its neighbours' planes and random changes of its own (Bleyer et al. 2011; Galliani et al. 2015).
// `step` is the sweep's spacing in inverse depth: the reach of the prior and of the changes.
void refine_view(const Photos& photos, int view, Neighbours neighbours, float step, const RefineSettings& settings,
                 float* planes, float* costs);

struct AgreeSettings {
  float pixels, relative;  // largest reprojection error, and difference of depth over depth
};

// What other views' planes (count, height, width, 3) say of one view's: how many agree, how many see through it, and
// the mean inverse depth of those that agree, its own included. Inverse depth that is not positive is none.
void agree_view(const Photos& photos, int view, Neighbours neighbours, const float* planes,
                const AgreeSettings& settings, float* inverse, std::uint8_t* agreeing, std::uint8_t* against);

}  // namespace goc
