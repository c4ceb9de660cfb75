// Registration of views, as Python sees it.
#include "arrays.hpp"
#include "register.hpp"

namespace goc {
namespace {

using Vectors = nb::ndarray<const float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Sums = nb::ndarray<double, nb::shape<kRegisterSums>, nb::c_contig, nb::device::cpu>;

class BoundSurface {
 public:
  BoundSurface(Vectors points, Vectors normals, Values grey)
      : points_(points), normals_(normals), grey_(grey) {
    const std::size_t count = points.shape(0);
    check(normals.shape(0) == count && grey.shape(0) == count, "one row a point");
  }
  Surface get() const {
    return {static_cast<int>(points_.shape(0)), points_.data(), normals_.data(), grey_.data()};
  }

 private:
  Vectors points_, normals_;
  Values grey_;
};

void bound_register(const BoundSurface& surface, const Camera& seen_from, const Camera& camera, Plane depth, Image normals,
                    Plane grey, nb::ndarray<const double, nb::shape<4>, nb::c_contig, nb::device::cpu> limits, Sums sums) {
  const std::size_t height = camera.height, width = camera.width;
  check(depth.shape(0) == height && depth.shape(1) == width, "depth must have the camera's height and width");
  check(grey.shape(0) == height && grey.shape(1) == width, "grey must have the camera's height and width");
  check(normals.shape(0) == height && normals.shape(1) == width && normals.shape(2) == 3, "three numbers a normal");
  check(height >= 2 && width >= 2, "an image needs two pixels each way");
  const double* l = limits.data();
  const Surface own = surface.get();
  const Target target{camera, depth.data(), normals.data(), grey.data()};
  nb::gil_scoped_release unlocked;
  register_surface(own, seen_from, target, {l[0], l[1], l[2], l[3]}, sums.data());
}

}  // namespace

void bind_register(nb::module_& module) {
  module.attr("REGISTER_SUMS") = static_cast<int>(kRegisterSums);
  nb::class_<BoundSurface>(module, "Surface", "Points, normals and grey that a view shows, in its own axes.")
      .def(nb::init<Vectors, Vectors, Values>(), nb::arg("points"), nb::arg("normals"), nb::arg("grey"));
  module.def("register_surface", &bound_register, nb::arg("surface"), nb::arg("seen_from"), nb::arg("camera"),
             nb::arg("depth"), nb::arg("normals"), nb::arg("grey"), nb::arg("limits"), nb::arg("sums").noconvert(),
             "Normal equations of the surface of one view against the images of another.");
}

}  // namespace goc
