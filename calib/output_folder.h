// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// A folder that receives all result files of a run or none: files are written beside their final
/// place under names that end in ".partial" and renamed together by `Commit`. Without `Commit` the
/// destructor removes them, and the folder too if this object made it and nothing else is inside.
class OutputFolder {
 public:
  /// Makes the folder if needed and checks that files can be written there, before the long work
  /// starts. Throws `Error` of kind kJob.
  explicit OutputFolder(std::filesystem::path folder);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Writes one file of the run; `name` may hold folders, which are made. Throws `Error` of kind
  /// kJob, for instance when the disk is full.
  void Write(const std::string& name, const std::string& content);
  /// Gives all written files their final names, replacing those of an earlier run.
  void Commit();

 private:
  void MakeFolder(const std::filesystem::path& folder);
  [[nodiscard]] std::filesystem::path PartialPath(const std::string& name) const;

  std::filesystem::path folder_;
  std::vector<std::filesystem::path> made_;  // folders that this object made, innermost first
  std::vector<std::string> names_;
  bool committed_ = false;
};

}  // namespace plenocal
