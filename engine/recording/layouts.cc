// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/layouts.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "calib/base/format_error.h"
#include "engine/recording/find_cameras.h"
#include "engine/recording/recorded_topics.h"
#include "engine/recording/stores/zip_archive.h"
#include "engine/recording/video/video_store.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// The path if there is a file or folder, else an empty one.
fs::path IfExists(const fs::path& path) {
  std::error_code error;
  return fs::exists(path, error) ? path : fs::path();
}

/// The folder "name", or the archive "name.zip"; empty if there is neither.
fs::path FolderOrArchive(const fs::path& path) {
  if (fs::is_directory(path)) return path;
  fs::path archive = path;
  archive += ".zip";
  return fs::is_regular_file(archive) ? archive : fs::path();
}

RecordedFiles CameraAt(const std::string& name, const fs::path& images, const fs::path& times) {
  RecordedFiles camera;
  camera.name = name;
  camera.where = images.string();
  camera.images = {images.string()};
  camera.times = times;
  return camera;
}

/// Sorted entries of a folder.
std::vector<fs::path> EntriesOf(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const auto& entry : fs::directory_iterator(folder)) entries.push_back(entry.path());
  std::ranges::sort(entries);
  return entries;
}

void AddForeign(const fs::path& path, const std::string& format, RecordingFile* file) {
  if (fs::exists(path)) file->foreign.push_back({path, format});
}

std::optional<RecordingFile> FindEuroc(const fs::path& folder) {
  const fs::path top = fs::is_directory(folder / "mav0") ? folder / "mav0" : folder;
  RecordingFile file{{.path = folder, .layout = "EuRoC"}};
  for (const fs::path& entry : EntriesOf(top)) {
    const std::string name = entry.filename().string();
    const fs::path images = FolderOrArchive(entry / "data");
    if (!name.starts_with("cam") || images.empty() || !fs::exists(entry / "data.csv")) continue;
    file.cameras.push_back(CameraAt(name, images, entry / "data.csv"));
    AddForeign(entry / "sensor.yaml", "", &file);
  }
  if (file.cameras.empty()) return std::nullopt;
  return file;
}

std::optional<RecordingFile> FindKitti(const fs::path& folder) {
  if (!fs::exists(folder / "times.txt")) return std::nullopt;
  RecordingFile file{{.path = folder, .layout = "KITTI"}};
  for (const char* name : {"image_0", "image_1", "image_2", "image_3"}) {
    const fs::path images = FolderOrArchive(folder / name);
    if (!images.empty()) file.cameras.push_back(CameraAt(name, images, folder / "times.txt"));
  }
  if (file.cameras.empty()) return std::nullopt;
  AddForeign(folder / "calib.txt", "", &file);
  return file;
}

std::optional<RecordingFile> FindTum(const fs::path& folder) {
  const fs::path images = FolderOrArchive(folder / "images"), times = folder / "times.txt";
  if (images.empty() || !fs::exists(times)) return std::nullopt;
  RecordingFile file{{.path = folder, .layout = "TUM monoVO"}};
  RecordedFiles camera = CameraAt("cam", images, times);
  camera.response = IfExists(folder / "pcalib.txt");
  camera.vignetting = IfExists(folder / "vignette.png");
  file.cameras.push_back(std::move(camera));
  AddForeign(folder / "camera.txt", "dso", &file);
  return file;
}

/// The times of a camera beside its images or beside all.
fs::path TimesBeside(const std::string& camera, const fs::path& images, const fs::path& folder) {
  if (fs::is_directory(images) && fs::exists(images / "times.txt")) return images / "times.txt";
  const fs::path own = IfExists(folder / fmt::format("times_{}.txt", camera));
  return own.empty() ? IfExists(folder / "times.txt") : own;
}

RecordingFile FindFolders(const fs::path& folder) {
  RecordingFile file{{.path = folder, .layout = "folders"}};
  std::vector<fs::path> archives;
  for (const fs::path& entry : EntriesOf(folder)) {
    const bool named = IsArchiveName(entry) || IsVideoName(entry);
    if (named && fs::is_regular_file(entry)) archives.push_back(entry);
  }
  try {
    for (const FoundCamera& found : FindCameras(folder)) {
      RecordedFiles camera = CameraAt(found.name, found.images[0], {});
      camera.images = found.images;
      camera.white_images = found.white;
      camera.times = TimesBeside(found.name, found.images[0], folder);
      file.cameras.push_back(std::move(camera));
    }
  } catch (const Error&) {
    if (archives.empty()) throw;
    for (const fs::path& archive : archives) {
      const std::string name = archive.stem().string();
      file.cameras.push_back(CameraAt(name, archive, TimesBeside(name, archive, folder)));
    }
  }
  return file;
}

RecordingFile FindInArchive(const fs::path& path) {
  RecordingFile file{{.path = path, .layout = "archive"}};
  const ZipArchive archive(path);
  for (const std::string& folder : ImageFoldersIn(archive)) {
    const std::string name = folder.empty() ? path.stem() : fs::path(folder).filename();
    file.cameras.push_back(CameraAt(name, path / folder, {}));
  }
  if (!file.cameras.empty()) return file;
  throw InputError("{}: no images (png, tiff, jpeg, bmp, pgm) in this archive", path.string());
}

}  // namespace

RecordingFile FindRecordingFile(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) {
    throw InputError("{}: no such file or folder; check the path", path.string());
  }
  if (IsArchiveName(path)) return FindInArchive(path);
  if (IsMessageFileName(path) || IsMessageFolder(path)) return FindInMessages(path);
  if (IsVideoName(path)) {
    RecordingFile file{{.path = path, .layout = "video"}};
    file.cameras.push_back(CameraAt(path.stem().string(), path, {}));
    return file;
  }
  if (!fs::is_directory(path)) return ReadRecordingFile(path);
  if (fs::exists(path / "recording.yaml")) return ReadRecordingFile(path / "recording.yaml");
  for (const auto find : {FindEuroc, FindKitti, FindTum}) {
    std::optional<RecordingFile> found = find(path);
    if (!found) continue;
    found->calibration = IfExists(path / "calibration.yaml");
    return *found;
  }
  RecordingFile file = FindFolders(path);
  file.calibration = IfExists(path / "calibration.yaml");
  return file;
}

}  // namespace plenocal
