// SPDX-License-Identifier: Apache-2.0
//
// Options that commands share, and the step from parsed options to the work.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "apps/cli/command.h"
#include "apps/cli/console.h"
#include "calib/camera/bayer.h"
#include "calib/space/point_fit.h"
#include "engine/recording/plenoptic_inputs.h"
#include "engine/session/image_session.h"
#include "engine/session/session_options.h"

namespace plenocal {

/// A command whose options `declare` writes into `Arguments`; `run` takes these and a console.
template <typename Arguments, typename Work>
Command MakeCommand(std::string_view name,
                    std::string help,
                    void (*declare)(CLI::App* app, Arguments* arguments, ConsoleOptions* shared),
                    Work run) {
  return {name, std::move(help), [declare, run](CLI::App* app, ConsoleOptions* shared) {
            const auto arguments = std::make_shared<Arguments>();
            declare(app, arguments.get(), shared);
            return [arguments, shared, run] {
              Console console(*shared);
              run(*arguments, &console);
            };
          }};
}

/// Declares `-o,--out`, which must be given.
void AddOut(CLI::App* app,
            std::filesystem::path* out,
            const std::string& help = "folder for the results");
/// Declares `--json`.
void AddJson(CLI::App* app, bool* json);
/// Declares `--frame`, rig or housing.
void AddSpaceFrame(CLI::App* app, SpaceFrame* frame);
/// Declares the argument `calibration`.
void AddCalibration(CLI::App* app, std::filesystem::path* calibration);
/// Declares the argument `recording`.
void AddRecording(CLI::App* app, std::filesystem::path* recording);
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
/// Declares `--target`, `--right` and `--camera`, which stand for a session file.
void AddImageArguments(CLI::App* app, ImageArguments* images);
/// Declares these and the argument `input`: a session file, or the images of a camera.
void AddInputs(CLI::App* app, ImageArguments* inputs);
/// The session file that inputs name; empty: they name images. Throws `Error` of kind kInput, which
/// begins with `command`, where they name nothing, or a session and more.
std::string SessionFileOf(const ImageArguments& inputs, const char* command);
/// The session that inputs name; of images all is open that `auto` may choose.
Session OpenInputs(const ImageArguments& inputs, const char* command, const Run& run);
/// Declares `--out`, `--threads`, `--quiet`, `--events`, `--exclude`, `--cache`, `--keep` and
/// `--fresh`.
void AddResultOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared);

}  // namespace plenocal
