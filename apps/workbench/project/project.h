// SPDX-License-Identifier: Apache-2.0
//
// Keeps the folder of a workbench: its session file with all versions, and the runs. Files are the
// state: a server that is started anew finds everything.
#pragma once

#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "calib/files/session.h"

namespace plenocal::workbench {

/// A session's text as it is now.
struct SessionVersion {
  std::string text, hash;
  bool undo = false, redo = false;  ///< there is something to undo, to redo
};

class Project {
 public:
  /// `place`: a folder, a session file, or the result of a calibration. Throws `Error` of kind
  /// kInput when it is not there, and of kind kJob when another workbench has it.
  explicit Project(const std::filesystem::path& place);
  ~Project();
  Project(const Project&) = delete;
  Project& operator=(const Project&) = delete;

  [[nodiscard]] const std::filesystem::path& Root() const { return root_; }
  [[nodiscard]] const std::filesystem::path& SessionFile() const { return session_; }
  /// A message with its paths relative to the root.
  [[nodiscard]] std::string Relative(std::string message) const;
  [[nodiscard]] bool HasSession() const;
  /// The session's text; a change from outside becomes a version of its own.
  SessionVersion ReadVersion();
  /// Throws `Error` with line and key when the text is no session.
  [[nodiscard]] Session Parsed();

  /// Writes a text, as a new version. Nothing when the file has not the content `hash` (any, when
  /// empty).
  std::optional<SessionVersion> Write(const std::string& text, const std::string& hash);
  /// Writes another file of the session, all of it or nothing.
  void WriteFile(const std::filesystem::path& file, const std::string& text);
  /// One version back or forth; nothing when there is none.
  std::optional<SessionVersion> Undo();
  std::optional<SessionVersion> Redo();

  /// Numbers of the folders runs/N with a calibration, ascending; 0 for one in the root itself.
  [[nodiscard]] std::vector<int> Runs() const;
  [[nodiscard]] std::filesystem::path RunFolder(int run) const;
  [[nodiscard]] int NextRun() const;

 private:
  void ReadHistory();
  void Record(const std::string& kind, const std::string& text);
  [[nodiscard]] std::string VersionText(int number) const;
  SessionVersion Now();
  std::optional<SessionVersion> Step(std::vector<int>* from, const char* kind);

  std::filesystem::path root_, session_, history_;
  std::mutex mutex_;
  int lock_ = -1;
  int current_ = 0, last_ = 0;    // version numbers; 0: none
  std::vector<int> undo_, redo_;  // versions to go back and forth to
};

}  // namespace plenocal::workbench
