// Python sees goc._native.depth_gaps; src/goc/extract/agreement.py is what the rest of goc uses.
#include "arrays.hpp"
#include "depth_gaps.hpp"

namespace goc {
namespace {

void bound_depth_gaps(In<kAny, 3> points, const Camera& camera, Plane depth, float one_surface, Flat between,
                      Flat nearest) {
  check(depth.shape(0) == static_cast<std::size_t>(camera.height) &&
            depth.shape(1) == static_cast<std::size_t>(camera.width),
        "depth must have the camera's height and width");
  check(between.size() == points.shape(0) && nearest.size() == points.shape(0), "one gap a point");
  nb::gil_scoped_release unlocked;
  depth_gaps(points.data(), points.shape(0), camera, depth.data(), one_surface, between.data(), nearest.data());
}

}  // namespace

void bind_depth_gaps(nb::module_& module) {
  module.def("depth_gaps", &bound_depth_gaps, nb::arg("points"), nb::arg("camera"), nb::arg("depth"),
             nb::arg("one_surface"), nb::arg("between"), nb::arg("nearest"),
             "Fill in how far behind each point a view's depth lies; NaN where it does not see the point.");
}

}  // namespace goc
