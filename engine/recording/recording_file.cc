// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/recording_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/files/calibration_file.h"
#include "calib/files/image_keys.h"
#include "calib/io/yaml.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// The value of `node`, one of `names`, as an index.
size_t OneOf(const YamlNode& node, std::span<const std::string_view> names) {
  const std::string name = node.AsString();
  const auto found = std::ranges::find(names, name);
  if (found != names.end()) return static_cast<size_t>(found - names.begin());
  node.Fail(fmt::format("unknown '{}'{}", name, SuggestName(name, names)));
}

/// A file that the recording names; it must be there.
fs::path FileBeside(const fs::path& file, const YamlNode& node) {
  fs::path path = PathBeside(file, node);
  std::error_code error;
  if (!fs::exists(path, error)) {
    node.Fail(fmt::format("{}: no such file; paths are relative to this file", path.string()));
  }
  return path;
}

RecordedFiles ReadRecordedFiles(const std::string& name,
                                const YamlNode& node,
                                const fs::path& file) {
  static constexpr std::array<std::string_view, 8> kKeys{
      "images", "topic", "tracks", "times", "exposure_unit", "white_images", "bayer", "pixel_size"};
  static constexpr std::array<std::string_view, 3> kUnits{"s", "ms", "us"};
  CheckName(name, node);
  node.CheckKeys(kKeys);
  RecordedFiles camera;
  camera.name = name;
  if (node.Has("tracks")) camera.tracks = FileBeside(file, node.At("tracks"));
  if (node.Has("images") || !node.Has("tracks")) {
    node.RequireKeys(std::array<std::string_view, 1>{"images"}, "images: left/*.png\n");
    const YamlNode images = node.At("images");
    camera.where = fmt::format("{}:{}: cameras.{}.images", file.string(), images.Line(), name);
    camera.images = ReadImagePatterns(file, node);
  } else {
    camera.where = fmt::format("{}:{}: cameras.{}", file.string(), node.Line(), name);
  }
  if (node.Has("times")) camera.times = FileBeside(file, node.At("times"));
  if (node.Has("exposure_unit")) {
    camera.exposure_unit = static_cast<ExposureUnit>(OneOf(node.At("exposure_unit"), kUnits));
  }
  if (node.Has("white_images")) camera.white_images = PathsBeside(file, node.At("white_images"));
  if (node.Has("bayer")) camera.bayer = ReadBayerOrder(node.At("bayer"));
  if (node.Has("pixel_size")) camera.pixel_size = node.At("pixel_size").AsLength();
  return camera;
}

MarkerFile ReadMarkerFileKeys(const YamlNode& node, const fs::path& file) {
  static constexpr std::array<std::string_view, 4> kNeeded{"frame", "marker", "x", "y"};
  node.CheckKeys({"file", "columns", "pixel_origin", "skip"});
  node.RequireKeys(std::array<std::string_view, 2>{"file", "columns"},
                   "file: markers.txt\ncolumns: [frame, marker, x, y]\n");
  MarkerFile markers{.path = FileBeside(file, node.At("file")), .columns = {}};
  const YamlNode columns = node.At("columns");
  for (const YamlNode& column : columns.Elements()) {
    const std::string name = column.AsString();
    if (std::ranges::find(markers.columns, name) != markers.columns.end()) {
      column.Fail(fmt::format("'{}' stands here twice; give each column a name of its own", name));
    }
    markers.columns.push_back(name);
  }
  for (const std::string_view name : kNeeded) {
    if (std::ranges::find(markers.columns, name) == markers.columns.end()) {
      columns.Fail(
          fmt::format("'{}' is missing; name all columns of the file, such as [frame, "
                      "marker, x, y, sigma]",
                      name));
    }
  }
  if (node.Has("pixel_origin")) {
    const YamlNode origin = node.At("pixel_origin");
    markers.pixel_origin = origin.AsNumber();
    if (markers.pixel_origin != 0 && markers.pixel_origin != 0.5 && markers.pixel_origin != 1) {
      origin.Fail(
          "expected the coordinate of the centre of the top-left pixel: 0, 0.5 or 1 (MATLAB)");
    }
  }
  if (node.Has("skip")) {
    markers.skip = node.At("skip").AsInteger();
    if (markers.skip < 0) node.At("skip").Fail("expected a number of lines, 0 or more");
  }
  return markers;
}

/// Calls set(camera, value) for each entry of the map `key`, which cameras' names lead to.
template <typename Set>
void ForCameras(const YamlNode& root, std::string_view key, RecordingFile* file, const Set& set) {
  if (!root.Has(key)) return;
  for (const auto& [name, value] : root.At(key).Entries()) {
    const auto camera = std::ranges::find(file->cameras, name, &RecordedFiles::name);
    if (camera == file->cameras.end()) {
      value.Fail(
          fmt::format("no camera is called so{}", SuggestName(name, NamesOf(file->cameras))));
    }
    set(&*camera, value);
  }
}

}  // namespace

RecordingFile ReadRecordingFile(const fs::path& path) {
  static constexpr std::array<std::string_view, 9> kKeys{"plenocal",
                                                         "cameras",
                                                         "pairing",
                                                         "calibration",
                                                         "truth",
                                                         "exposures",
                                                         "response",
                                                         "vignetting",
                                                         "markers"};
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  root.CheckKeys(kKeys);
  root.RequireKeys(std::array<std::string_view, 1>{"cameras"},
                   "cameras: {left: {images: left/*.png}}\n");
  RecordingFile file{{.path = path, .layout = "recording.yaml"}};
  for (const auto& [name, node] : root.At("cameras").Entries()) {
    file.cameras.push_back(ReadRecordedFiles(name, node, path));
  }
  if (file.cameras.empty()) root.At("cameras").Fail("expected at least one camera");
  if (root.Has("pairing")) file.pairing = ReadPairing(root.At("pairing"));
  if (root.Has("calibration")) file.calibration = FileBeside(path, root.At("calibration"));
  if (root.Has("truth")) file.truth = FileBeside(path, root.At("truth"));
  if (root.Has("exposures")) file.exposures = FileBeside(path, root.At("exposures"));
  ForCameras(root, "response", &file, [&](RecordedFiles* camera, const YamlNode& node) {
    camera->response = FileBeside(path, node);
  });
  ForCameras(root, "vignetting", &file, [&](RecordedFiles* camera, const YamlNode& node) {
    camera->vignetting = FileBeside(path, node);
  });
  ForCameras(root, "markers", &file, [&](RecordedFiles* camera, const YamlNode& node) {
    camera->markers = ReadMarkerFileKeys(node, path);
  });
  return file;
}

}  // namespace plenocal
