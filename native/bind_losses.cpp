// Python face of the fused losses, of Adam and of normals from depth.
#include <algorithm>
#include <cmath>
#include <optional>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "geometry_loss.hpp"
#include "lanes.hpp"
#include "photometric.hpp"
#include "plane_normals.hpp"
#include "threads.hpp"

namespace goc {
namespace {

using Bytes = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using PackedNormals = nb::ndarray<const std::int8_t, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

template <class Planes, class Image>
Lens checked_lens(const Planes& planes, const Camera& camera, const Image& numerator, const Image& denominator) {
  const auto fits = [&](std::size_t h, std::size_t w) {
    return h == (std::size_t)camera.height && w == (std::size_t)camera.width;
  };
  check(planes.shape(0) == 4 && fits(planes.shape(1), planes.shape(2)), "planes must be (4, height, width)");
  check(fits(numerator.shape(0), numerator.shape(1)) && fits(denominator.shape(0), denominator.shape(1)),
        "images must have the camera's height and width");
  return camera.lens();
}

}  // namespace

void bind_losses(nb::module_& module) {
  nb::class_<Photometric>(module, "Photometric", "L_c = (1 − λ)·L1 + λ·(1 − SSIM) and its gradient; keeps a workspace.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](Photometric& self, Image x, Bytes target, float ssim_weight, ImageOut grad) {
            check(x.shape(0) == 3 && target.shape(0) == x.shape(1) && target.shape(1) == x.shape(2),
                  "x must be (3, height, width) and target (height, width, 3)");
            for (int k = 0; k < 3; ++k) check(x.shape(k) == grad.shape(k), "grad must have the shape of x");
            nb::gil_scoped_release release;
            const auto found =
                self(x.data(), target.data(), (int)x.shape(1), (int)x.shape(2), ssim_weight, grad.data());
            return std::pair(found.loss, found.square_error);
          },
          nb::arg("x"), nb::arg("target"), nb::arg("ssim_weight"), nb::arg("grad"));

  nb::class_<GeometryLoss>(module, "GeometryLoss", "L_d and L_dn of a rendered depth and their gradient.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](GeometryLoss& self, Plane numerator, Plane denominator, Plane alpha, Plane prior_depth,
             std::optional<In<kAny, kAny, 3>> normals, std::optional<PackedNormals> packed, const Camera& camera,
             float depth_weight, float normal_weight, PlaneOut numerator_grad, PlaneOut denominator_grad) {
            const auto fits = [&](const auto& a) {
              return a.shape(0) == (std::size_t)camera.height && a.shape(1) == (std::size_t)camera.width;
            };
            check(fits(numerator) && fits(denominator) && fits(alpha) && fits(prior_depth) && fits(numerator_grad) &&
                      fits(denominator_grad) && (!normals || fits(*normals)) && (!packed || fits(*packed)),
                  "images must have the camera's height and width");
            const DepthImages images{numerator.data(),   denominator.data(),
                                     alpha.data(),       prior_depth.data(),
                                     normals ? normals->data() : nullptr, packed ? packed->data() : nullptr};
            const Lens lens = camera.lens();
            nb::gil_scoped_release release;
            const GeometryLosses losses =
                self(images, lens, depth_weight, normal_weight, numerator_grad.data(), denominator_grad.data());
            return std::pair(losses.depth, losses.depth_normal);
          },
          nb::arg("numerator"), nb::arg("denominator"), nb::arg("alpha"), nb::arg("prior_depth"),
          nb::arg("normals").none(), nb::arg("packed_normals").none(), nb::arg("camera"), nb::arg("depth_weight"),
          nb::arg("normal_weight"), nb::arg("numerator_grad"), nb::arg("denominator_grad"));
  module.def(
      "plane_fraction",
      [](Image planes, const Camera& camera, PlaneOut numerator, PlaneOut denominator) {
        const Lens lens = checked_lens(planes, camera, numerator, denominator);
        nb::gil_scoped_release release;
        plane_fraction(planes.data(), lens, numerator.data(), denominator.data());
      },
      "Numerator and denominator of the depth of blended planes (4 h w).");
  module.def(
      "plane_fraction_backward",
      [](Plane numerator_grad, Plane denominator_grad, const Camera& camera, ImageOut planes_grad) {
        const Lens lens = checked_lens(planes_grad, camera, numerator_grad, denominator_grad);
        nb::gil_scoped_release release;
        plane_fraction_backward(numerator_grad.data(), denominator_grad.data(), lens, planes_grad.data());
      },
      "The gradient of the planes.");
  module.def(
      "plane_normals",
      [](Plane depth, const Camera& camera, int radius, float agree, int fewest, ImageOut normals) {
        check(depth.shape(0) == (std::size_t)camera.height && depth.shape(1) == (std::size_t)camera.width,
              "depth must have the camera's height and width");
        check(normals.shape(0) == depth.shape(0) && normals.shape(1) == depth.shape(1) && normals.shape(2) == 3,
              "normals must be (height, width, 3)");
        const Lens lens = camera.lens();
        nb::gil_scoped_release release;
        plane_normals(depth.data(), lens, radius, agree, fewest, normals.data());
      },
      nb::arg("depth"), nb::arg("camera"), nb::arg("radius"), nb::arg("agree"),
      nb::arg("fewest"), nb::arg("normals"), "Normals of planes fitted to windows of a depth image.");
  module.def(
      "adam",
      [](PlaneOut x, Plane grad, PlaneOut first, PlaneOut second, const std::vector<double>& rates, double beta1,
         double beta2, double epsilon, int step) {
        const std::size_t n = x.shape(0), width = x.shape(1);
        const auto fits = [&](const auto& a) { return a.shape(0) == n && a.shape(1) == width; };
        check(fits(grad) && fits(first) && fits(second), "x, grad and moments differ in shape");
        check(rates.size() == width, "every column needs a rate");
        check(step >= 1, "steps count from 1");
        const double unbias = std::sqrt(1.0 - std::pow(beta2, step)), scale = unbias / (1.0 - std::pow(beta1, step));
        std::vector<float> pattern(16 * width);
        for (std::size_t k = 0; k < pattern.size(); ++k) pattern[k] = (float)(rates[k % width] * scale);
        const AdamStep adam{(float)beta1, (float)beta2, (float)(epsilon * unbias), pattern.data(), (int)width};
        nb::gil_scoped_release release;
        parallel_for(n, 4096, [&](std::size_t begin, std::size_t end) {
          const std::size_t at = begin * width;
          kernels().adam_rows({x.data() + at, grad.data() + at, first.data() + at, second.data() + at}, end - begin, adam);
        });
      },
      nb::arg("x"), nb::arg("grad"), nb::arg("first"), nb::arg("second"), nb::arg("rates"), nb::arg("beta1"),
      nb::arg("beta2"), nb::arg("epsilon"), nb::arg("step"), "One Adam step on (rows, columns), in place.");
  module.def(
      "add_penalties",
      [](In<kAny> logits, In<kAny, 3> log_scales, float opacity, float scale, Flat logits_grad,
         nb::ndarray<float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu> log_scales_grad) {
        const std::size_t n = logits.shape(0);
        check(log_scales.shape(0) == n && logits_grad.shape(0) == n && log_scales_grad.shape(0) == n,
              "parameters and gradients differ in length");
        nb::gil_scoped_release release;
        const float* grad = logits_grad.data();
        const auto seen = (std::size_t)std::count_if(grad, grad + n, [](float g) { return g != 0.0f; });
        if (seen == 0) return;
        const float each = 1.0f / (float)seen;
        parallel_for(n, 4096, [&](std::size_t begin, std::size_t end) {
          kernels().penalty_rows(logits.data() + begin, log_scales.data() + 3 * begin, end - begin, opacity * each,
                                 scale * each / 3.0f, logits_grad.data() + begin, log_scales_grad.data() + 3 * begin);
        });
      },
      nb::arg("logits"), nb::arg("log_scales"), nb::arg("opacity"), nb::arg("scale"), nb::arg("logits_grad"),
      nb::arg("log_scales_grad"),
      "Adds the gradients of opacity·mean(opacities) and scale·mean(scales), over the splats with a gradient.");
}

}  // namespace goc
