// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/options.h"

namespace plenocal {

void AddThreads(CLI::App* app, ConsoleOptions* shared) {
  constexpr int kMostThreads = 1024;  // more is a slip of the finger
  app->add_option("--threads", shared->threads, "number of threads (default: all cores)")
      ->check(CLI::Range(1, kMostThreads));
}

void AddQuiet(CLI::App* app, ConsoleOptions* shared) {
  app->add_flag("--quiet", shared->quiet, "no messages and no progress, only errors");
}

void AddBayer(CLI::App* app, std::optional<BayerOrder>* bayer, const std::string& help) {
  app->add_option_function<std::string>(
         "--bayer", [bayer](const std::string& name) { *bayer = ParseBayerOrder(name); }, help)
      ->check(CLI::IsMember(std::vector<std::string>(kBayerOrders.begin(), kBayerOrders.end())));
}

void AddSessionOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared) {
  app->add_option("session", options->session, "session.yaml: cameras, images, target")->required();
  AddResultOptions(app, options, shared);
}

void AddResultOptions(CLI::App* app, SessionOptions* options, ConsoleOptions* shared) {
  app->add_option("-o,--out", options->out, "folder for the results")->required();
  AddThreads(app, shared);
  AddQuiet(app, shared);
  app->add_flag(
      "--keep",
      options->keep,
      "write pictures of the stages into OUT/images/<camera>: markers drawn, of a plenoptic camera focused image, depth and micro-lens grid as well");
  app->add_flag(
      "--fresh",
      options->fresh,
      "detect again in all images (default: detections of earlier runs into OUT are reused where nothing has changed)");
}

}  // namespace plenocal
