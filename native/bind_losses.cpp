// Python face of the fused losses, of Adam and of normals from depth.
#include <cmath>
#include <optional>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include "arrays.hpp"
#include "geometry_loss.hpp"
#include "lanes.hpp"
#include "photometric.hpp"
#include "plane_normals.hpp"
#include "threads.hpp"

namespace goc {

void bind_losses(nb::module_& module) {
  nb::class_<Photometric>(module, "Photometric", "L_c = (1 − λ)·L1 + λ·(1 − SSIM) and its gradient; keeps a workspace.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](Photometric& self, Image x, Image y, float ssim_weight, ImageOut grad) {
            for (int k = 0; k < 3; ++k)
              check(x.shape(k) == y.shape(k) && x.shape(k) == grad.shape(k), "images must have one shape (c h w)");
            nb::gil_scoped_release release;
            return self(x.data(), y.data(), (int)x.shape(0), (int)x.shape(1), (int)x.shape(2), ssim_weight,
                        grad.data());
          },
          nb::arg("x"), nb::arg("y"), nb::arg("ssim_weight"), nb::arg("grad"));

  nb::class_<GeometryLoss>(module, "GeometryLoss", "L_d and L_dn of a rendered depth and their gradient.")
      .def(nb::init<>())
      .def(
          "__call__",
          [](GeometryLoss& self, Plane numerator, Plane denominator, Plane alpha, Plane prior_depth, std::optional<In<kAny, kAny, 3>> normals,
             float fx, float fy, float cx, float cy, float depth_weight, float normal_weight, PlaneOut numerator_grad,
             PlaneOut denominator_grad) {
            const auto same = [&](const auto& a) { return a.shape(0) == numerator.shape(0) && a.shape(1) == numerator.shape(1); };
            check(same(denominator) && same(alpha) && same(prior_depth) && same(numerator_grad) && same(denominator_grad) && (!normals || same(*normals)),
                  "images must have one height and width");
            const DepthView view{numerator.data(), denominator.data(), alpha.data(), prior_depth.data(), normals ? normals->data() : nullptr,
                                 (int)numerator.shape(1), (int)numerator.shape(0), fx, fy, cx, cy};
            nb::gil_scoped_release release;
            const GeometryLosses losses = self(view, depth_weight, normal_weight, numerator_grad.data(), denominator_grad.data());
            return std::pair(losses.depth, losses.depth_normal);
          },
          nb::arg("numerator"), nb::arg("denominator"), nb::arg("alpha"), nb::arg("prior_depth"), nb::arg("prior_normals").none(), nb::arg("fx"),
          nb::arg("fy"), nb::arg("cx"), nb::arg("cy"), nb::arg("depth_weight"), nb::arg("normal_weight"),
          nb::arg("numerator_grad"), nb::arg("denominator_grad"));
  module.def(
      "plane_normals",
      [](Plane depth, float fx, float fy, float cx, float cy, int radius, float agree, int fewest, ImageOut normals) {
        check(normals.shape(0) == depth.shape(0) && normals.shape(1) == depth.shape(1) && normals.shape(2) == 3,
              "normals must be (height, width, 3)");
        const DepthImage image{depth.data(), (int)depth.shape(1), (int)depth.shape(0), fx, fy, cx, cy};
        nb::gil_scoped_release release;
        plane_normals(image, radius, agree, fewest, normals.data());
      },
      nb::arg("depth"), nb::arg("fx"), nb::arg("fy"), nb::arg("cx"), nb::arg("cy"), nb::arg("radius"), nb::arg("agree"),
      nb::arg("fewest"), nb::arg("normals"), "Normals of planes fitted to windows of a depth image.");
  module.def(
      "adam",
      [](Flat x, In<kAny> grad, Flat first, Flat second, double rate, double beta1, double beta2, double epsilon,
         int step) {
        const std::size_t n = x.shape(0);
        check(grad.shape(0) == n && first.shape(0) == n && second.shape(0) == n, "x, grad and moments differ in length");
        check(step >= 1, "steps count from 1");
        const double unbias = std::sqrt(1.0 - std::pow(beta2, step));
        const AdamStep adam{(float)(rate * unbias / (1.0 - std::pow(beta1, step))), (float)beta1, (float)beta2,
                            (float)(epsilon * unbias)};
        nb::gil_scoped_release release;
        parallel_for(n, 1 << 14, [&](std::size_t begin, std::size_t end) {
          kernels().adam_run(x.data() + begin, grad.data() + begin, first.data() + begin, second.data() + begin,
                             end - begin, adam);
        });
      },
      nb::arg("x"), nb::arg("grad"), nb::arg("first"), nb::arg("second"), nb::arg("rate"), nb::arg("beta1"),
      nb::arg("beta2"), nb::arg("epsilon"), nb::arg("step"), "One Adam step, in place.");
}

}  // namespace goc
