// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/view_options.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "apps/cli/options.h"
#include "engine/resample/remap.h"

namespace plenocal {

void AddViewOptions(CLI::App* app, ViewOptions* view) {
  AddImageSize(app, &view->size, "WIDTHxHEIGHT of the result (default: the camera's)");
  CLI::Option* const fov =
      app->add_option("--fov", view->fov, "horizontal field of view, degrees, square pixels")
          ->check(CLI::Range(1.0, 175.0));
  app->add_option(
         "--balance",
         view->balance,
         "0: largest view of which every pixel has a source, 1: all that the camera sees (default: the camera's scale on the optical axis)")
      ->check(CLI::Range(0.0, 1.0))
      ->excludes(fov);
  AddDistance(app, &view->distance);
}

void AddDistance(CLI::App* app, std::optional<double>* distance) {
  app->add_option(
      "--distance",
      *distance,
      "m, at which the result is exact for a camera without a single centre (model with "
      "pupil; default: the target's)");
}

void AddResampleOptions(CLI::App* app, ResampleSettings* resample) {
  app->add_option("--interpolation", resample->interpolation, "between pixels")
      ->check(
          CLI::IsMember(std::vector<std::string>(kInterpolations.begin(), kInterpolations.end())))
      ->capture_default_str();
  AddBayer(app,
           &resample->bayer,
           "colours of the top-left 2 x 2 pixels of raw mosaics, which become colour images");
  app->add_option(
         "--photometric",
         resample->photometric,
         "pcalib.txt of 'plenocal response': results are proportional to the light, 16 bits; "
         "of several cameras NAME=pcalib.txt,NAME=...")
      ->delimiter(',');
  app->add_flag("--keep-vignetting",
                resample->keep_vignetting,
                "leave it in the images (default: removed where the calibration has it)");
  app->add_flag("--mask", resample->mask, "write mask.png: 255 where pixels have a source, else 0");
}

std::string ViewText(const CalibratedCamera& view) {
  const auto degrees = [&](size_t axis) {
    const double f = view.params[axis], c = view.params[2 + axis];
    return (std::atan((c + 0.5) / f) + std::atan((view.image_size[axis] - 0.5 - c) / f)) *
           (180 / std::numbers::pi);
  };
  return fmt::format("{} x {} px, f {:.2f} {:.2f} px, c {:.2f} {:.2f} px, {:.1f} x {:.1f} degrees",
                     view.image_size[0],
                     view.image_size[1],
                     view.params[0],
                     view.params[1],
                     view.params[2],
                     view.params[3],
                     degrees(0),
                     degrees(1));
}

}  // namespace plenocal
