// Python face of the multi-view losses.
#include <optional>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include "arrays.hpp"
#include "multiview.hpp"

namespace goc {
namespace {

using Photograph = nb::ndarray<const std::uint8_t, nb::shape<kAny, kAny, 3>, nb::c_contig, nb::device::cpu>;

template <typename Array>
bool fits(const Array& image, const Lens& lens) {
  return image.shape(0) == (std::size_t)lens.height && image.shape(1) == (std::size_t)lens.width;
}

struct View {
  Plane numerator, denominator, alpha;
  Photograph image;
  Lens lens;

  WarpedView arrays() const {
    check(fits(numerator, lens) && fits(denominator, lens) && fits(alpha, lens) && fits(image, lens),
          "images must have the height and width of the lens");
    check(lens.width > 1, "a view must be more than a pixel wide");  // a pixel is read as four bytes
    return {numerator.data(), denominator.data(), alpha.data(), image.data(), lens};
  }
};

struct Source {
  Photograph image;
  Lens lens;
  Plane inverse_depth;
  Lens depth_lens;
  In<3, 4> from_view;

  WarpSource arrays() const {
    check(fits(image, lens) && fits(inverse_depth, depth_lens), "images must have the height and width of the lens");
    return {image.data(), lens, inverse_depth.data(), depth_lens, from_view.data()};
  }
};

}  // namespace

void bind_multiview(nb::module_& module) {
  nb::class_<View>(module, "WarpedView", "A rendered depth (numerator / denominator) and what was photographed there.")
      .def(
          "__init__",
          [](View* self, Plane numerator, Plane denominator, Plane alpha, Photograph image, const Lens& lens) {
            new (self) View{numerator, denominator, alpha, image, lens};
            self->arrays();
          },
          nb::arg("numerator"), nb::arg("denominator"), nb::arg("alpha"), nb::arg("image"), nb::arg("lens"));
  nb::class_<Source>(module, "WarpSource", "A neighbour's photograph and inverse depth (0 = none).")
      .def(
          "__init__",
          [](Source* self, Photograph image, const Lens& lens, Plane inverse_depth, const Lens& depth_lens,
             In<3, 4> from_view) {
            new (self) Source{image, lens, inverse_depth, depth_lens, from_view};
            self->arrays();
          },
          nb::arg("image"), nb::arg("lens"), nb::arg("inverse_depth"), nb::arg("depth_lens"), nb::arg("from_view"));
  nb::class_<MultiviewLoss>(module, "MultiviewLoss", "L_pho and L_geo of a rendered depth and their gradient.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](MultiviewLoss& self, const View& view, const Source& source, float photometric, float geometric,
             float tolerance, PlaneOut numerator_grad, PlaneOut denominator_grad, std::optional<PlaneOut> inverse_grad) {
            const WarpedView warped = view.arrays();
            const WarpSource from = source.arrays();
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
