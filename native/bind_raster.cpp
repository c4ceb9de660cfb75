// Python face of the rasteriser.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <optional>
#include <stdexcept>

#include "arrays.hpp"
#include "raster.hpp"

namespace nb = nanobind;

namespace goc {
namespace {

// The arrays of n splats, checked together.
struct Splats {
  In<kAny, 3> means;
  In<kAny, 4> quats;
  In<kAny, 3> log_scales;
  In<kAny> opacity_logits;

  SplatArrays arrays() const {
    const std::size_t n = means.shape(0);
    if (quats.shape(0) != n || log_scales.shape(0) != n || opacity_logits.shape(0) != n)
      throw std::invalid_argument("means, quats, log_scales and opacity_logits differ in length");
    return {means.data(), quats.data(), log_scales.data(), opacity_logits.data(), n};
  }
};

}  // namespace

void bind_raster(nb::module_& module) {
  module.attr("MAX_ALPHA") = kMaxAlpha;
  module.attr("MIN_ALPHA") = kMinAlpha;
  module.attr("MIN_TRANSMITTANCE") = kMinTransmittance;
  module.attr("NEAR") = kNear;
  module.attr("DILATION") = kDilation;
  module.def("simd_level", [] { return kernels().name; }, "Instruction set that the kernels use on this machine.");

  nb::class_<Splats>(module, "Splats", "The arrays of n splats: means (n 3), quats (n 4), log_scales (n 3), logits (n).")
      .def("__init__",
           [](Splats* self, In<kAny, 3> means, In<kAny, 4> quats, In<kAny, 3> log_scales, In<kAny> logits) {
             new (self) Splats{means, quats, log_scales, logits};
             self->arrays();
           });

  nb::class_<RasterCamera>(module, "RasterCamera", "cam_from_world (4 4), fx, fy, cx, cy, width, height.")
      .def("__init__", [](RasterCamera* self, In<4, 4> view, float fx, float fy, float cx, float cy, int width,
                          int height) {
        check(width > 0 && height > 0 && width <= 32767 && height <= 32767, "width and height must be in 1..32767");
        check(fx > 0 && fy > 0, "focal lengths must be positive");
        new (self) RasterCamera{{}, fx, fy, cx, cy, width, height};
        for (int i = 0; i < 16; ++i) self->view[i] = view.data()[i];
      });

  nb::class_<Raster>(module, "Raster", "One rendered view and the buffers behind it; reusable for another view.")
      .def(nb::init<>())
      .def_prop_ro("records", &Raster::records, "(tile, splat) pairs of the last view.")
      .def(
          "forward",
          [](Raster& self, const Splats& splats, const RasterCamera& camera, Plane channels, ImageOut image,
             PlaneOut alpha) {
            const SplatArrays arrays = splats.arrays();
            check(channels.shape(0) == arrays.size, "channels must have one row a splat");
            const std::size_t h = camera.height, w = camera.width;
            check(image.shape(0) == channels.shape(1) && image.shape(1) == h && image.shape(2) == w,
                  "image must be (channels, height, width)");
            check(alpha.shape(0) == h && alpha.shape(1) == w, "alpha must be (height, width)");
            nb::gil_scoped_release release;
            self.forward(arrays, channels.data(), (int)channels.shape(1), camera, image.data(), alpha.data());
          },
          "Render channels (n c) into image (c h w) and alpha (h w).")
      .def(
          "backward",
          [](Raster& self, const Splats& splats, Plane channels, Image image, Plane alpha, Image image_grad,
             std::optional<Plane> alpha_grad, PlaneOut channels_grad, std::optional<PlaneOut> means,
             std::optional<PlaneOut> quats, std::optional<PlaneOut> log_scales, std::optional<Flat> logits) {
            const SplatArrays arrays = splats.arrays();
            const auto rows = [&](const auto& a, std::size_t width) {
              check(a.shape(0) == arrays.size && a.shape(1) == width, "a gradient has the wrong shape");
            };
            rows(channels, channels.shape(1));
            rows(channels_grad, channels.shape(1));
            for (int k = 0; k < 3; ++k) check(image.shape(k) == image_grad.shape(k), "image_grad differs from image");
            SplatGradients out{};
            if (means) {
              check(quats && log_scales && logits, "gradients of the splats come together");
              rows(*means, 3), rows(*quats, 4), rows(*log_scales, 3);
              check(logits->shape(0) == arrays.size, "a gradient has the wrong shape");
              out = {means->data(), quats->data(), log_scales->data(), logits->data()};
            }
            const float* upstream = alpha_grad ? alpha_grad->data() : nullptr;
            nb::gil_scoped_release release;
            self.backward(arrays, channels.data(), image.data(), alpha.data(), image_grad.data(), upstream,
                          means ? &out : nullptr, channels_grad.data());
          },
          nb::arg("splats"), nb::arg("channels"), nb::arg("image"), nb::arg("alpha"), nb::arg("image_grad"),
          nb::arg("alpha_grad").none(), nb::arg("channels_grad"), nb::arg("means").none(), nb::arg("quats").none(),
          nb::arg("log_scales").none(), nb::arg("logits").none(),
          "Gradients of the last forward; rows of splats outside the view are left alone (pass zeros).")
      .def("median", [](const Raster& self, nb::ndarray<std::int32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu> out) {
        check(out.shape(0) == (std::size_t)self.height() && out.shape(1) == (std::size_t)self.width(),
              "out must be (height, width) of the last view");
        self.median(out.data());
      }, "Splat at which each pixel of the last view turns half opaque; -1 where none does.")
      .def("visible", [](const Raster& self, nb::ndarray<std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> out) {
        self.visible(out.data());
      }, "One byte a splat: 1 where it touches the view.");
}

}  // namespace goc
