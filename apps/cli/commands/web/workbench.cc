// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/workbench.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>

#include "apps/cli/options.h"
#include "apps/workbench/worker/worker.h"
#include "calib/base/error.h"

extern char** environ;

namespace plenocal {
namespace {

struct WorkbenchArguments {
  workbench::WorkbenchOptions options{.place = "."};
  bool open = true;     ///< the browser
  bool worker = false;  ///< runs the jobs of the workbench that has started this process
};

// A page that leads to the address: on a command line other users would see the token. The file is
// readable by its owner alone and removed when the browser has had time to read it.
class OpenedBrowser {
 public:
  explicit OpenedBrowser(const std::string& address) {
    std::string file = std::filesystem::temp_directory_path() / "plenocal-XXXXXX.html";
    constexpr int kEnding = 5;                           // ".html"
    const int written = mkstemps(file.data(), kEnding);  // mode 0600
    if (written < 0) return;
    const std::string page = fmt::format(
        "<!doctype html><meta http-equiv=\"refresh\" content=\"0; url={}\">\n", address);
    const bool complete =
        write(written, page.data(), page.size()) == static_cast<ssize_t>(page.size());
    close(written);
    file_ = file;
    if (!complete) return;
    std::string program = "xdg-open";
    char* const argv[] = {program.data(), file.data(), nullptr};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
      posix_spawn_file_actions_addopen(&actions, stream, "/dev/null", O_RDWR, 0);
    }
    pid_t child = 0;
    // Without one the address stands on the terminal.
    (void)posix_spawnp(&child, program.c_str(), &actions, nullptr, argv, environ);
    posix_spawn_file_actions_destroy(&actions);
  }
  ~OpenedBrowser() { RemoveFile(); }
  OpenedBrowser(const OpenedBrowser&) = delete;
  OpenedBrowser& operator=(const OpenedBrowser&) = delete;

  void RemoveWhenRead() {
    constexpr auto kTime = std::chrono::seconds(20);
    if (!file_.empty() && std::chrono::steady_clock::now() - opened_ > kTime) RemoveFile();
  }

 private:
  void RemoveFile() {
    std::error_code error;
    if (!file_.empty()) std::filesystem::remove(file_, error);
    file_.clear();
  }

  std::string file_;
  std::chrono::steady_clock::time_point opened_ = std::chrono::steady_clock::now();
};

void ServeWorkbench(const WorkbenchArguments& arguments, Console* /*console*/) {
  if (arguments.worker) return workbench::ServeJobs(workbench::kWorkerSocket);
  std::unique_ptr<OpenedBrowser> browser;
  workbench::RunWorkbench(
      arguments.options,
      [&](const std::string& address) {
        fmt::print("{}\nCtrl-C ends the workbench; everything is kept in files.\n", address);
        FlushOutput();
        if (arguments.open) browser = std::make_unique<OpenedBrowser>(address);
      },
      [&] {
        if (browser) browser->RemoveWhenRead();
        return !Interrupted();
      });
}

constexpr const char* kWorkbenchHelp =
    "The workbench in the browser: propose a session, look at detections, calibrate, exclude images, be told what to record next, export.\n\n"
    "  plenocal workbench images/\n\n"
    "serves a page on this machine alone, prints its address and opens it. The folder (or that of the session file) holds all that it does: session.yaml, runs/, .plenocal/. docs/workbench.md shows the screens.";

void DeclareWorkbench(CLI::App* app, WorkbenchArguments* arguments, ConsoleOptions* /*shared*/) {
  app->add_option("place",
                  arguments->options.place,
                  "folder with images or a session, session file, or folder of a calibration")
      ->capture_default_str();
  app->add_option("--port", arguments->options.port, "port; 0: a free one")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  app->add_flag("!--no-open", arguments->open, "do not open a browser");
  app->add_flag("--worker", arguments->worker)->group("");
}

}  // namespace

Command WorkbenchCommand() {
  return MakeCommand("workbench", kWorkbenchHelp, DeclareWorkbench, ServeWorkbench);
}

}  // namespace plenocal
