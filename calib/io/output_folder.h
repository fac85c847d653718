// SPDX-License-Identifier: Apache-2.0
//
// Result files that are written all or none, and the completion of writes that were interrupted.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "calib/io/announced_moves.h"

namespace plenocal {

/// A folder that receives all result files of a run or none: files are written into its subfolder
/// ".partial" and moved together by `Commit`. Without `Commit` the destructor removes them, and the
/// folder too if this object made it and nothing else is inside.
///
/// No file is written or removed outside of the folder, and none that this run has read
/// (input_file.h) is replaced, whatever names it is given; nor is a symbolic link, device or pipe.
///
/// A run that is killed (also by SIGKILL) or loses power leaves the old files or all new ones: the
/// files are on the disk before a file "complete" in ".partial" announces them, the moves are made
/// by a process of their own, which outlives this one, and where it is stopped as well, the next
/// run that writes or opens the folder (`CompleteResults`) completes the moves; until then its
/// files are not read. What was not announced the next writer removes.
class OutputFolder {
 public:
  /// Makes the folder if needed and checks that files can be written there, before the long work
  /// starts; clears up behind a killed run. Throws `Error` of kind kJob, also when another process
  /// writes there.
  explicit OutputFolder(const std::filesystem::path& folder);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Throws `Error` of kind kInput when a result of one of these names would replace an input, and
  /// of kind kJob where it would replace anything but a regular file: before the long work rather
  /// than in `Write`.
  void RefuseInputs(const std::vector<std::string>& names) const;
  /// Writes one file of the run; `name` may have folders ("images/left/01.png"). May be called from
  /// several threads. Throws `Error` of kind kJob, for instance when the disk is full or the name
  /// leads out of the folder, and of kind kInput when it would replace an input.
  void Write(const std::string& name, const std::string& content);
  /// A file of an earlier run that this run, if it ends well, leaves out: `Commit` removes it,
  /// unless it was written again.
  void Remove(const std::string& name) { removed_.push_back(name); }
  /// Gives all written files their final names, replacing those of an earlier run.
  void Commit();

 private:
  friend void AbandonOutput();
  [[nodiscard]] std::filesystem::path Partial() const { return folder_ / kPartial; }
  void Lock();
  void Discard();

  std::filesystem::path folder_;
  std::vector<std::string> removed_;
  std::vector<std::filesystem::path> made_;  // folders that this object made, innermost first
  int lock_ = -1;                            // of the folder
  bool announced_ = false;                   // the files in ".partial" are complete
};

/// Null for an empty path: no folder is wanted.
std::unique_ptr<OutputFolder> OpenOutput(const std::filesystem::path& folder);

/// Writes the file that an option names, as an `OutputFolder` does. What a symbolic link leads to
/// is written, and the link stays. A FIFO or character device is written to, also standard output
/// by its names in /dev. Throws `Error` of kind kInput for a folder, block device or socket.
void WriteOutput(const std::filesystem::path& file, std::string content);

/// Names of files and their contents.
using OutputContents = std::vector<std::pair<std::string, std::string>>;

/// Writes several files in the folder of `file`, which may be one of them; where `file` is a
/// link, they lie beside what it leads to. Returns their paths.
std::vector<std::filesystem::path> WriteOutputs(const std::filesystem::path& file,
                                                OutputContents contents);

/// All results of a run in its `OutputFolder`; an empty path is the working folder. Returns the
/// files' paths.
std::vector<std::filesystem::path> WriteInto(const std::filesystem::path& folder,
                                             const OutputContents& contents);

/// Opens a folder of results: completes the moves of a killed run in `path`, where it is a folder,
/// and in the three folders above it. The first step of all that reads results of earlier runs.
/// Throws `Error` of kind kJob where that is not possible.
void CompleteResults(const std::filesystem::path& path);

/// Removes what this process has written and not committed, and lets no thread write or commit from
/// now on: for a process that is about to end. Waits for a commit that has begun.
void AbandonOutput();

}  // namespace plenocal
