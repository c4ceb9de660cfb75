// Python face of the camera that all kernels take.
#include <array>

#include <nanobind/stl/array.h>

#include "arrays.hpp"
#include "camera.hpp"

namespace goc {
namespace {

using Pair = std::array<double, 2>;
using Rows = std::array<std::array<double, 4>, 3>;

void make(Camera* self, Pair focal, Pair centre, int width, int height, const Rows& cam_from_world,
          const Rows& world_from_cam) {
  check(width > 0 && height > 0, "a camera must have a width and a height");
  check(focal[0] > 0 && focal[1] > 0, "focal lengths must be positive");
  new (self) Camera{focal[0], focal[1], centre[0], centre[1], width, height, {}, {}};
  for (int i = 0; i < 12; ++i) {
    self->cam_from_world[i] = cam_from_world[i / 4][i % 4];
    self->world_from_cam[i] = world_from_cam[i / 4][i % 4];
  }
}

}  // namespace

void bind_camera(nb::module_& module) {
  nb::class_<Camera>(module, "Camera", "A posed pinhole camera; poses are the upper three rows of rigid 4x4 matrices.")
      .def("__init__", &make, nb::arg("focal"), nb::arg("centre"), nb::arg("width"), nb::arg("height"),
           nb::arg("cam_from_world"), nb::arg("world_from_cam"));
}

}  // namespace goc
