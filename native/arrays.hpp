// Arrays as they come from Python: float32, C-contiguous, on the CPU. Included by bind_*.cpp alone.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>

namespace nb = nanobind;

namespace goc {

template <nb::ssize_t... N>
using In = nb::ndarray<const float, nb::shape<N...>, nb::c_contig, nb::device::cpu>;
constexpr nb::ssize_t kAny = -1;

using Image = nb::ndarray<const float, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Plane = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using ImageOut = nb::ndarray<float, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using PlaneOut = nb::ndarray<float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Flat = nb::ndarray<float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

inline void check(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

}  // namespace goc
