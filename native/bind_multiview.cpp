// Python face of the multi-view losses.
#include <array>
#include <optional>

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include "arrays.hpp"
#include "multiview.hpp"

namespace goc {
namespace {

using Photograph = nb::ndarray<const std::uint8_t, nb::shape<kAny, kAny, 3>, nb::c_contig, nb::device::cpu>;
using Focal = std::array<float, 4>;  // fx, fy, cx, cy

template <typename Array>
Lens lens_of(const Focal& focal, const Array& image) {
  return {focal[0], focal[1], focal[2], focal[3], (int)image.shape(1), (int)image.shape(0)};
}

struct View {
  Plane numerator, denominator, alpha;
  Photograph image;
  Focal focal;

  WarpedView arrays() const {
    for (int k = 0; k < 2; ++k)
      check(denominator.shape(k) == numerator.shape(k) && alpha.shape(k) == numerator.shape(k) &&
                image.shape(k) == numerator.shape(k),
            "images must have one height and width");
    return {numerator.data(), denominator.data(), alpha.data(), image.data(), lens_of(focal, image)};
  }
};

struct Source {
  Photograph image;
  Focal focal;
  Plane inverse_depth;
  Focal depth_focal;
  In<3, 4> from_view;

  WarpSource arrays() const {
    return {image.data(), lens_of(focal, image), inverse_depth.data(), lens_of(depth_focal, inverse_depth),
            from_view.data()};
  }
};

}  // namespace

void bind_multiview(nb::module_& module) {
  nb::class_<View>(module, "WarpedView", "A rendered depth (numerator / denominator) and what was photographed there.")
      .def(
          "__init__",
          [](View* self, Plane numerator, Plane denominator, Plane alpha, Photograph image, const Focal& lens) {
            new (self) View{numerator, denominator, alpha, image, lens};
            self->arrays();
          },
          nb::arg("numerator"), nb::arg("denominator"), nb::arg("alpha"), nb::arg("image"), nb::arg("lens"));
  nb::class_<Source>(module, "WarpSource", "A neighbour's photograph and inverse depth (0 = none).")
      .def(
          "__init__",
          [](Source* self, Photograph image, const Focal& lens, Plane inverse_depth, const Focal& depth_lens,
             In<3, 4> from_view) { new (self) Source{image, lens, inverse_depth, depth_lens, from_view}; },
          nb::arg("image"), nb::arg("lens"), nb::arg("inverse_depth"), nb::arg("depth_lens"), nb::arg("from_view"));
  nb::class_<MultiviewLoss>(module, "MultiviewLoss", "L_pho and L_geo of a rendered depth and their gradient.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](MultiviewLoss& self, const View& view, const Source& source, float photometric, float geometric,
             float tolerance, PlaneOut numerator_grad, PlaneOut denominator_grad, std::optional<PlaneOut> inverse_grad) {
            const WarpedView warped = view.arrays();
            const WarpSource from = source.arrays();
            const auto fits = [](const PlaneOut& out, const Lens& lens) {
              return (int)out.shape(0) == lens.height && (int)out.shape(1) == lens.width;
            };
            check(fits(numerator_grad, warped.lens) && fits(denominator_grad, warped.lens) &&
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
