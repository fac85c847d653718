// SPDX-License-Identifier: Apache-2.0
//
// Options of the commands that make images of a pinhole camera: map, undistort, rectify.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "engine/images/image_folder.h"
#include "engine/resample/pinhole_view.h"

namespace plenocal {

/// Declares `--size`, `--fov`, `--balance` and `--distance`.
void AddViewOptions(CLI::App* app, ViewOptions* view);
/// Declares `--distance`, that of `CentralView`.
void AddDistance(CLI::App* app, std::optional<double>* distance);
/// Declares `--interpolation`, `--bayer`, `--keep-vignetting`, `--photometric` and `--mask`.
void AddResampleOptions(CLI::App* app, ResampleSettings* resample);

/// One line about a pinhole camera: size, focal lengths, principal point, fields of view.
std::string ViewText(const CalibratedCamera& view);

}  // namespace plenocal
