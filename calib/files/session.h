// SPDX-License-Identifier: Apache-2.0
//
// session.yaml as data, and its reader.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/base/robust.h"
#include "calib/camera/bayer.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/image_circle.h"
#include "calib/camera/param_rule.h"
#include "calib/camera/rigid_transform.h"
#include "calib/files/frame_images.h"
#include "calib/files/pairing_key.h"
#include "calib/files/scene_keys.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// The model of a camera with `model: auto` until one is chosen.
inline constexpr std::string_view kUsualModel = "pinhole-radtan";
/// The value of keys that leave a choice to the program.
inline constexpr std::string_view kAuto = "auto";

/// The file of an earlier calibration.
struct EarlierFile {
  std::filesystem::path path;  ///< empty: none
  std::string format;          ///< of another tool's file, as `plenocal import` takes it; or empty
};

/// One camera of a session. Of session.yaml exactly one of `images` and `detections` is given, of
/// one in memory exactly one of `given_images` and `given_views`.
struct SessionCamera {
  std::string name;
  const CameraModel* model = nullptr;
  bool auto_model = false;  ///< to be chosen by held-out frames; until then `model` is a usual one
  std::vector<std::string> images;        ///< globs, folders and files; empty when there are none
  std::vector<std::string> white_images;  ///< likewise
  std::optional<BayerOrder> bayer;        ///< of raw mosaics
  std::filesystem::path detections;
  std::vector<FrameImage> given_images;        ///< in memory, in place of `images`
  std::vector<View> given_views;               ///< in memory, in place of `detections`
  std::filesystem::path times;                 ///< of the images; empty: as the images have them
  ImageSize image_size{};                      ///< {0, 0}: taken from the images
  std::optional<ImageCircle> image_circle;     ///< not set: taken from the images
  std::vector<double> config;                  ///< the model's config values
  std::vector<std::optional<double>> initial;  ///< per parameter
  std::vector<bool> fixed;                     ///< per parameter
  /// Per parameter, or empty when the session has none; cameras are indices of `Session::cameras`.
  std::vector<ParamRule> rules;
  EarlierFile from;       ///< its own earlier calibration; empty: the session's
  EarlierParams earlier;  ///< of a camera with `from`
};

/// True for a camera whose images are to be searched for the target.
inline bool HasImages(const SessionCamera& camera) {
  return !camera.images.empty() || !camera.given_images.empty();
}

/// The target of a session: a file, or what the session has in place of its path.
struct TargetSource {
  std::filesystem::path file;    ///< empty: `keys` is set
  std::optional<YamlNode> keys;  ///< a map with the keys of target.yaml, or a target in one word

  /// The content of the file, or the keys as YAML; empty when the file cannot be read.
  [[nodiscard]] std::string Text() const;
};

/// One of several targets of a session.
struct SessionTarget {
  std::string name;
  TargetSource source;
  bool moves = false;                   ///< with respect to the others, from frame to frame
  std::optional<RigidTransform> known;  ///< its frame to that of the first target
};

/// A rule `exclude` of a session. An image belongs to the rule if camera and frame do.
struct ExcludeRule {
  std::string camera = {};  ///< empty: all
  std::string frame = {};   ///< name of a frame or of its file, or a glob of these; empty: all
  std::vector<int> markers = {};  ///< empty: the whole image
  std::string note = {};          ///< the reason, in the user's words; may be empty
};

/// session.yaml: the cameras to calibrate with their images, target and options (docs/formats.md).
struct Session {
  std::filesystem::path path;
  std::string text;                      ///< of the file
  TargetSource target;                   ///< of several, the first
  std::vector<SessionTarget> targets;    ///< empty: `target` is the only one
  std::optional<SceneKeys> scene;        ///< in place of a target
  std::vector<SceneDistance> distances;  ///< between markers, of several targets by `MarkerId`
  EarlierFile from;                      ///< of all cameras that name none themselves
  bool extrinsics_only = false;          ///< parameters stay those of `from`
  std::vector<SessionCamera> cameras;    ///< the first is the rig's master
  /// Not set: marker positions are refined when the target has a tolerance.
  std::optional<bool> refine_target;
  bool auto_refine = false;  ///< `refine_target` is to be chosen by held-out frames
  Loss loss = Loss::kHuber;
  std::vector<ExcludeRule> exclude;
  Pairing pairing;
  std::optional<size_t> frames;  ///< most frames to use, of more the best; nothing: as usual
  bool all_frames = false;       ///< however many there are
};

/// The shared libraries with camera models that a session names; absolute paths.
std::vector<std::filesystem::path> ReadSessionPlugins(const std::filesystem::path& path);

/// Reads and checks a session. Throws `Error` with file, line and key.
Session ReadSession(const std::filesystem::path& path, std::span<const CameraModel> models);
/// Reads a session from `text`, which is or will be the content of `path`.
Session ParseSession(const std::string& text,
                     const std::filesystem::path& path,
                     std::span<const CameraModel> models);

/// Adds rules in YAML ("camera: left, frame: '07'") to a session, and to its text. Throws `Error`
/// that begins with the rule.
void AddExcludeRules(const std::vector<std::string>& rules, Session* session);

}  // namespace plenocal
