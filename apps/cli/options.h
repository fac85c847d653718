// SPDX-License-Identifier: Apache-2.0
//
// Options that several commands have.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>

#include "apps/cli/console.h"
#include "calib/camera/bayer.h"
#include "engine/recording/plenoptic_inputs.h"
#include "engine/session/session_options.h"

namespace plenocal {

/// Declares `--threads`.
void AddThreads(CLI::App* app, ConsoleOptions* shared);
/// Declares `--quiet`.
void AddQuiet(CLI::App* app, ConsoleOptions* shared);
/// Declares both.
void AddThreadsAndQuiet(CLI::App* app, ConsoleOptions* shared);
/// Declares `--events`: an open file descriptor.
void AddEvents(CLI::App* app, ConsoleOptions* shared);
/// Declares `--bayer`, one of `kBayerOrders`.
void AddBayer(CLI::App* app, std::optional<BayerOrder>* bayer, const std::string& help);
/// Declares `--size`, "640x480", of images.
void AddImageSize(CLI::App* app, std::optional<ImageSize>* size, const std::string& help);
/// Declares `--white`, `--grid`, `--vignetting` and `--bayer`.
void AddPlenopticInputs(CLI::App* app, PlenopticInputs* inputs);
/// Declares `--out`, `--threads`, `--quiet`, `--events`, `--exclude`, `--cache`, `--keep` and
/// `--fresh`.
void AddResultOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared);
/// Declares the session and the same.
void AddSessionOptions(CLI::App* app,
                       std::filesystem::path* session,
                       SessionOptions* options,
                       ConsoleOptions* shared);

}  // namespace plenocal
