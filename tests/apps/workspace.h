// SPDX-License-Identifier: Apache-2.0
//
// Runs the built program as a user does: files in, exit status, messages and files out.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <csignal>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tests/calib/synthetic.h"

namespace plenocal::testing {

/// What a command left behind.
struct Outcome {
  int status = -1;  ///< as a shell gives it: 128 + number when a signal ended the program
  std::string out;  ///< standard output
  std::string err;  ///< standard error
};

struct RunOptions {
  std::string stdout_path = {};      ///< where standard output goes; empty: into Outcome::out
  std::string stderr_path = {};      ///< the same of standard error
  bool close_streams = false;        ///< standard input, output and error are closed
  std::size_t file_size_limit = 0;   ///< bytes that a file may have, as on a full disk; 0: any
  std::size_t open_files_limit = 0;  ///< 0: as the test's own
  bool no_environment = false;       ///< only the variables of `environment`
  std::function<bool()> interrupt_when = {};  ///< `signal` is sent once this is true
  int signal = SIGINT;
  std::map<std::string, std::string> environment = {};  ///< variables beside the test's own
};

/// A CSV file with a header line.
class Table {
 public:
  explicit Table(const std::string& text);
  [[nodiscard]] std::size_t Rows() const { return rows_.size(); }
  /// The cells of one column.
  [[nodiscard]] std::vector<std::string> Column(const std::string& name) const;
  [[nodiscard]] std::vector<double> Numbers(const std::string& name) const;

 private:
  std::vector<std::string> header_;
  std::vector<std::vector<std::string>> rows_;
};

/// A fresh folder that is the program's working directory, so that messages hold short paths.
class Workspace : public ::testing::Test {
 protected:
  Workspace();
  ~Workspace() override;

  [[nodiscard]] std::filesystem::path Path(const std::string& name) const { return folder_ / name; }
  void Write(const std::string& name, const std::string& text) const;
  [[nodiscard]] std::string Read(const std::string& name) const;
  /// Names and contents of all files in a folder; empty when there is none.
  [[nodiscard]] std::map<std::string, std::string> Files(const std::string& folder) const;

  /// Names of the files in a folder, without the detections kept for later runs.
  [[nodiscard]] std::vector<std::string> Results(const std::string& folder) const;

  Outcome Run(const std::vector<std::string>& arguments, const RunOptions& options = {}) const;
  /// `plenocal calibrate session.yaml -o out`, which must succeed.
  Outcome Calibrate(const std::string& out = "out") const;
  /// `plenocal <command> session.yaml -o out` must fail with this status, one line that holds all
  /// of `parts`, and no result files.
  void ExpectFailure(int status,
                     const std::vector<std::string>& parts,
                     const std::string& command = "calibrate") const;

  /// target.yaml, session.yaml and one detections CSV a camera.
  void WriteProblem(const SyntheticProblem& problem) const;
  /// out/calibration.yaml.
  [[nodiscard]] YAML::Node Result(const std::string& out = "out") const;

 private:
  std::filesystem::path folder_;
};

/// An ordinary problem that calibrates well; `cameras` on one rig.
SyntheticProblem EasyProblem(int cameras = 1, double marker_tolerance = 0);
/// Its detections as a file.
std::string DetectionsText(const CameraInput& camera);
/// session.yaml with the cameras of a problem, markers held.
std::string SessionText(const SyntheticProblem& problem);
/// `text` with the one place that reads `from` changed; fails the test when there is none.
std::string Replaced(std::string text, const std::string& from, const std::string& to);
std::vector<std::string> Lines(const std::string& text);

/// Every number below `node` is finite or infinite, none NaN.
void ExpectNoNan(const YAML::Node& node, const std::string& path = "");
Eigen::Matrix4d Matrix(const YAML::Node& node);

inline constexpr int kDone = 0;
inline constexpr int kJobFailed = 1;
inline constexpr int kWrongInput = 2;
inline constexpr int kInterrupted = 130;

}  // namespace plenocal::testing
