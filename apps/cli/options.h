// SPDX-License-Identifier: Apache-2.0
//
// Options that several commands have.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/cli/console.h"
#include "calib/camera/bayer.h"

namespace plenocal {

struct Session;

/// Options of the commands that detect the target in a session's images.
struct SessionOptions {
  std::filesystem::path session;     ///< session.yaml
  std::filesystem::path out;         ///< folder for the results
  bool keep = false;                 ///< write pictures of the stages into OUT/images
  std::vector<std::string> exclude;  ///< rules beside the session's, in YAML
  std::filesystem::path cache;       ///< folder of the detections kept for later runs; empty: `out`
  int frames = 0;                    ///< most frames to use; 0: the session's number
  bool all = false;                  ///< use all frames
  bool fresh = false;                ///< detect again: ignore detections of earlier runs
};

/// Sets the number of frames in the session as given by `--frames` and `--all`.
void UseFrameOptions(const SessionOptions& options, Session* session);

/// Declares `--threads`.
void AddThreads(CLI::App* app, ConsoleOptions* shared);
/// Declares `--quiet`.
void AddQuiet(CLI::App* app, ConsoleOptions* shared);
/// Declares `--events`: an open file descriptor.
void AddEvents(CLI::App* app, ConsoleOptions* shared);
/// Declares `--bayer`, one of `kBayerOrders`.
void AddBayer(CLI::App* app, std::optional<BayerOrder>* bayer, const std::string& help);
/// Declares `--out`, `--threads`, `--quiet`, `--events`, `--exclude`, `--cache`, `--keep` and
/// `--fresh`.
void AddResultOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared);
/// Declares the session and the same.
void AddSessionOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared);

}  // namespace plenocal
