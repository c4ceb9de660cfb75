// Python face of the multi-view losses.
#include <optional>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include "arrays.hpp"
#include "multiview.hpp"

namespace goc {
namespace {

using Photograph = nb::ndarray<const std::uint8_t, nb::shape<kAny, kAny, 3>, nb::c_contig, nb::device::cpu>;

template <typename Array, typename Size>
bool fits(const Array& image, const Size& lens) {
  return image.shape(0) == (std::size_t)lens.height && image.shape(1) == (std::size_t)lens.width;
}

struct View {
  Plane numerator, denominator, alpha;
  Photograph image;
  Camera camera;

  WarpedView arrays() const {
    check(fits(numerator, camera) && fits(denominator, camera) && fits(alpha, camera) && fits(image, camera),
          "images must have the camera's height and width");
    check(camera.width > 1, "a view must be more than a pixel wide");  // a pixel is read as four bytes
    return {numerator.data(), denominator.data(), alpha.data(), image.data(), camera};
  }
};

struct Source {
  Photograph image;
  Camera camera;
  Plane inverse_depth;
  int stride;

  WarpSource arrays() const {
    check(fits(image, camera), "images must have the camera's height and width");
    check(stride >= 1, "a stride must be at least one pixel");
    const Lens depth_lens = camera.lens(stride, (int)inverse_depth.shape(1), (int)inverse_depth.shape(0));
    return {image.data(), camera, inverse_depth.data(), depth_lens};
  }
};

}  // namespace

void bind_multiview(nb::module_& module) {
  nb::class_<View>(module, "WarpedView", "A rendered depth (numerator / denominator) and what was photographed there.")
      .def(
          "__init__",
          [](View* self, Plane numerator, Plane denominator, Plane alpha, Photograph image, const Camera& camera) {
            new (self) View{numerator, denominator, alpha, image, camera};
            self->arrays();
          },
          nb::arg("numerator"), nb::arg("denominator"), nb::arg("alpha"), nb::arg("image"), nb::arg("camera"));
  nb::class_<Source>(module, "WarpSource", "A neighbour's photograph and inverse depth (0 = none).")
      .def(
          "__init__",
          [](Source* self, Photograph image, const Camera& camera, Plane inverse_depth, int stride) {
            new (self) Source{image, camera, inverse_depth, stride};
            self->arrays();
          },
          nb::arg("image"), nb::arg("camera"), nb::arg("inverse_depth"), nb::arg("stride"));
  nb::class_<MultiviewLoss>(module, "MultiviewLoss", "L_pho and L_geo of a rendered depth and their gradient.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](MultiviewLoss& self, const View& view, const Source& source, float photometric, float geometric,
             float tolerance, PlaneOut numerator_grad, PlaneOut denominator_grad, std::optional<PlaneOut> inverse_grad) {
            const WarpedView warped = view.arrays();
            const WarpSource from = source.arrays();
            check(fits(numerator_grad, warped.camera) && fits(denominator_grad, warped.camera) &&
                      (!inverse_grad || fits(*inverse_grad, from.depth_lens)),
                  "gradients must have their image's height and width");
            nb::gil_scoped_release release;
            const MultiviewLosses losses = self(warped, from, {photometric, geometric, tolerance}, numerator_grad.data(),
                                                denominator_grad.data(), inverse_grad ? inverse_grad->data() : nullptr);
            return std::pair(losses.photometric, losses.geometric);
          },
          nb::arg("view"), nb::arg("source"), nb::arg("photometric"), nb::arg("geometric"), nb::arg("tolerance"),
          nb::arg("numerator_grad"), nb::arg("denominator_grad"), nb::arg("inverse_grad").none());
}

}  // namespace goc
