// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// A folder that receives all result files of a run or none: files are written into its subfolder
/// ".partial" and moved together by `Commit`. Without `Commit` the destructor removes them, and the
/// folder too if this object made it and nothing else is inside.
///
/// A run that is killed (also by SIGKILL) leaves the old files or all new ones: the moves are made
/// by a process of their own, which outlives this one, and are announced by a file in ".partial",
/// so that after a power cut the next run completes them. What was not announced it removes.
class OutputFolder {
 public:
  /// Makes the folder if needed and checks that files can be written there, before the long work
  /// starts; clears up behind a killed run. Throws `Error` of kind kJob, also when another process
  /// writes there.
  explicit OutputFolder(std::filesystem::path folder);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Writes one file of the run; `name` may have folders ("images/left/01.png"). May be called from
  /// several threads. Throws `Error` of kind kJob, for instance when the disk is full.
  void Write(const std::string& name, const std::string& content);
  /// A file of an earlier run that this run, if it ends well, leaves out: `Commit` removes it,
  /// unless it was written again.
  void Remove(const std::string& name) { removed_.push_back(name); }
  /// Gives all written files their final names, replacing those of an earlier run.
  void Commit();

 private:
  [[nodiscard]] std::filesystem::path Partial() const { return folder_ / ".partial"; }

  std::filesystem::path folder_;
  std::vector<std::string> removed_;
  std::vector<std::filesystem::path> made_;  // folders that this object made, innermost first
  int lock_ = -1;                            // of the folder
};

}  // namespace plenocal
