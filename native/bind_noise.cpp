// Python sees goc._native.fractal_noise; src/goc/synth/noise.py is what the rest of goc uses.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cmath>
#include <stdexcept>

#include "noise.hpp"

namespace nb = nanobind;
using nb::literals::operator""_a;

namespace goc {
namespace {

using Points = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Lattice = nb::ndarray<const float, nb::shape<kNoisePeriod, kNoisePeriod, kNoisePeriod>,
                            nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<float, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

void fill_fractal_noise(Points points, Lattice lattice, int octaves, Values values) {
  if (values.shape(0) != points.shape(0)) throw std::invalid_argument("fractal_noise: arrays of different lengths");
  if (octaves < 1 || octaves > 16) throw std::invalid_argument("fractal_noise: needs 1 to 16 octaves");
  for (std::size_t i = 0; i < 3 * points.shape(0); ++i) {
    // Beyond this, floor() would not fit an integer.
    if (!(std::abs(points.data()[i]) < 1e12)) {
      throw std::invalid_argument("fractal_noise: a point is not finite or too far");
    }
  }
  nb::gil_scoped_release release;
  fractal_noise(points.data(), points.shape(0), lattice.data(), octaves, values.data());
}

}  // namespace

void bind_noise(nb::module_& module) {
  module.def("fractal_noise", &fill_fractal_noise, "points"_a, "lattice"_a, "octaves"_a, "values"_a,
             "Fill octaves of value noise at each point, in the range of the lattice.");
}

}  // namespace goc
