// SPDX-License-Identifier: Apache-2.0
//
// A model of COLMAP (its folder with cameras and images, as text or binary) as a session without a
// target: the points that its images share are the tracks, its cameras' parameters the start. Its
// poses and points are not taken: the calibration finds them again.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/colmap_files.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/import_format.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// The model's file of that name: binary where both are there, as COLMAP reads it.
fs::path FileOf(const fs::path& model, const std::string& name) {
  std::error_code error;
  if (!fs::is_directory(model, error)) {
    throw InputError("{}: is no folder; give the folder of the model, with its cameras and images",
                     model.string());
  }
  const fs::path binary = model / (name + ".bin");
  return fs::exists(binary, error) ? binary : model / (name + ".txt");
}

/// The name of each camera: the folder of its images, where it alone has images there; else
/// "camera3".
std::map<std::uint64_t, std::string> NameCameras(const std::vector<ColmapImage>& images) {
  std::map<std::uint64_t, std::set<std::string>> folders;
  std::map<std::string, std::set<std::uint64_t>> cameras;
  for (const ColmapImage& image : images) {
    const std::string folder = fs::path(image.name).parent_path().string();
    folders[image.camera].insert(folder);
    cameras[folder].insert(image.camera);
  }
  std::map<std::uint64_t, std::string> names;
  for (const auto& [camera, of_camera] : folders) {
    std::string name = *of_camera.begin();
    std::ranges::replace(name, '/', '_');
    const bool alone = of_camera.size() == 1 && cameras.at(*of_camera.begin()).size() == 1;
    names[camera] =
        !alone || CameraNameDefect(name) ? fmt::format("camera{}", camera) : std::move(name);
  }
  return names;
}

/// The frame of each image: its name without folder and extension.
std::string FrameOf(const ColmapImage& image) {
  std::string frame = fs::path(image.name).stem().string();
  if (const auto defect = FrameNameDefect(frame)) {
    throw InputError("{}: the image's name {}", image.where, *defect);
  }
  return frame;
}

std::string SessionYaml(const std::vector<CalibratedCamera>& cameras,
                        const std::map<std::string, std::string>& names) {
  std::string text =
      "plenocal: 1\n"
      "# The points of a COLMAP model. For lengths in metres add to `scene`:\n"
      "#   distances: [{between: [point 12, point 40], length: 1.2 m, sigma: 1 mm}]\n"
      "scene: {}\n"
      "cameras:\n";
  for (const CalibratedCamera& camera : cameras) {
    const std::string& name = names.at(camera.name);
    text += fmt::format("  {}:\n    model: {}\n    image_size: [{}, {}]\n    initial: {{",
                        YamlQuoted(name),
                        camera.model->name,
                        camera.image_size[0],
                        camera.image_size[1]);
    for (size_t i = 0; i < camera.params.size(); ++i) {
      text += fmt::format(
          "{}{}: {}", i == 0 ? "" : ", ", camera.model->params[i].name, RealText(camera.params[i]));
    }
    text += fmt::format("}}\n    detections: {}\n", YamlQuoted("detections_" + name + ".csv"));
  }
  return text;
}

ImportedFile ReadColmapModel(const ImportSource& source) {
  const std::vector<ColmapImage> images = ReadColmapImages(FileOf(source.path, "images"));
  const std::map<std::uint64_t, std::string> names = NameCameras(images);
  std::map<std::string, std::string> tables;                 // by camera
  std::map<std::pair<std::string, std::string>, int> taken;  // images of a camera and frame
  std::set<int> points;
  for (const ColmapImage& image : images) {
    const std::string& camera = names.at(image.camera);
    const std::string frame = FrameOf(image);
    if (++taken[{camera, frame}] > 1) {
      throw InputError(
          "{}: camera '{}' has two images that would be frame '{}'", image.where, camera, frame);
    }
    std::string& table = tables.try_emplace(camera, "frame,marker,x,y\n").first->second;
    std::map<int, int> times;
    for (const ColmapObservation& seen : image.observations) ++times[seen.point];
    for (const ColmapObservation& seen : image.observations) {
      if (times[seen.point] > 1) continue;  // which of them is right is open
      points.insert(seen.point);
      table += fmt::format("{},{},{},{}\n", CsvCell(frame), seen.point, seen.x, seen.y);
    }
  }
  if (points.empty()) {
    throw InputError("{}: its images show no points that have a position", source.path.string());
  }

  std::vector<CalibratedCamera> cameras;
  std::map<std::string, std::string> name_of;  // by the name that the format `colmap` gives
  for (const auto& [camera, name] : names) name_of[fmt::format("camera{}", camera)] = name;
  const fs::path file = FileOf(source.path, "cameras");
  for (CalibratedCamera& camera :
       ReadCameraFile(*FindCameraFormat("colmap", file), {.path = file, .image_size = {}})) {
    if (name_of.contains(camera.name)) cameras.push_back(std::move(camera));
  }
  if (cameras.size() != names.size()) {
    throw InputError("{}: lacks cameras of the images", file.string());
  }
  ImportedFile imported{
      .content = SessionYaml(cameras, name_of),
      .message = fmt::format("{} points in {} images", points.size(), images.size())};
  for (auto& [camera, table] : tables) {
    imported.beside.emplace_back("detections_" + camera + ".csv", std::move(table));
  }
  return imported;
}

}  // namespace

ImportFormat ColmapModelFormat() {
  return {.name = "colmap-model",
          .source = "a model's folder",
          .result = "session.yaml",
          .read = ReadColmapModel};
}

}  // namespace plenocal
