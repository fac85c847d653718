// SPDX-License-Identifier: Apache-2.0
//
// Images and a target on the command line in place of a session file.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/session.h"
#include "targets/target.h"

namespace plenocal {

/// The options of the command line that stand for a session.
struct ImageArguments {
  std::vector<std::string> images;   ///< of one camera: globs, files or a folder
  std::vector<std::string> right;    ///< of a second camera; empty: there is none
  std::vector<std::string> cameras;  ///< "NAME=GLOB", in place of `images`
  std::string target;                ///< in one word, or a file; empty: to be found in the images
};

/// A session file to be, with the target beside it.
class ImageSession {
 public:
  /// Throws `Error` of kind kInput for arguments that do not fit. Without a target the images are
  /// looked at; then the message proposes one.
  ImageSession(const ImageArguments& arguments, const std::filesystem::path& out, const Run& run);

  /// The session with one `model` for all cameras and a value of `refine_target`; empty: the option
  /// is left out.
  [[nodiscard]] Session With(std::string_view model, std::string_view refine_target) const;
  [[nodiscard]] const Target& target() const { return target_; }
  /// The target file that the session names.
  [[nodiscard]] const std::string& target_text() const { return target_text_; }

  static constexpr const char* kSessionName = "session.yaml";
  static constexpr const char* kTargetName = "nominal_target.yaml";

 private:
  struct Camera {
    std::string name;
    std::vector<std::string> images;  ///< globs, files or a folder, as the user gave them
  };
  [[nodiscard]] std::string Text(std::string_view model, std::string_view refine_target) const;

  std::vector<Camera> cameras_;
  std::filesystem::path out_;
  TargetSource source_;
  Target target_;
  std::string target_text_;
};

}  // namespace plenocal
