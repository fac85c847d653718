// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/readers.h"

#include <fmt/format.h>
#include <unistd.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <span>
#include <sstream>
#include <stdexcept>

#include "apps/cli/command_line.h"
#include "apps/cli/fleet/fleet_plan.h"
#include "apps/evaluate/truth_uncertainty.h"
#include "apps/simulate/spec/simulation_spec.h"
#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/files/detections.h"
#include "calib/files/session.h"
#include "calib/io/detection_cache.h"
#include "calib/rig/trajectory.h"
#include "detectors/images/image.h"
#include "detectors/photometry/response_curve.h"
#include "detectors/plenoptic/cached_results.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/colmap_files.h"
#include "engine/formats/import_format.h"
#include "engine/formats/pose_matrices.h"
#include "engine/recording/frames/times.h"
#include "engine/recording/recording_file.h"
#include "engine/recording/stores/message_log.h"
#include "engine/recording/stores/zip_archive.h"
#include "engine/recording/supplied_detections.h"
#include "models/plugin/load_plugin.h"
#include "models/registry.h"
#include "targets/target.h"
#include "tests/fuzz/commands.h"
#include "tests/fuzz/workbench_request.h"

namespace plenocal::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr ImageSize kImageSize{640, 480};

// A folder in memory that is removed at the end of the program.
class Folder {
 public:
  Folder() : path_(fmt::format("/dev/shm/plenocal_fuzz_{}", getpid())) {
    fs::create_directories(path_);
  }
  ~Folder() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  fs::path Write(const std::string& name, std::string_view content) const {
    std::ofstream(path_ / name, std::ios::binary) << content;
    return path_ / name;
  }

 private:
  fs::path path_;
};

const Folder& FolderOfRun() {
  static const Folder folder;
  return folder;
}

void RequireFinite(const char* what, std::span<const double> numbers) {
  if (std::ranges::all_of(numbers, [](double number) { return std::isfinite(number); })) return;
  throw std::logic_error(fmt::format("{} that are not finite: {}", what, fmt::join(numbers, " ")));
}

template <typename Matrix>
void RequireFiniteMatrix(const char* what, const Matrix& matrix) {
  RequireFinite(what, {matrix.data(), static_cast<size_t>(matrix.size())});
}

void RequireFinitePose(const RigidTransform& T) {
  RequireFiniteMatrix("rotations", T.R);
  RequireFiniteMatrix("translations", T.t);
}

// What was written from a result is read again; a refusal is a defect.
void RequireReadable(const std::string& name,
                     const std::string& content,
                     const std::function<void(const fs::path&)>& read) {
  try {
    read(FolderOfRun().Write(name, content));
  } catch (const Error& error) {
    throw std::logic_error(fmt::format("a file made from the input is refused: {}", error.what()));
  }
}

// ---- files of ours

void ReadSessionFile(const fs::path& path) {
  static_cast<void>(ReadSessionPlugins(path));
  const Session session = ReadSession(path, CameraModels());
  for (const SessionCamera& camera : session.cameras) {
    RequireFinite("config values", camera.config);
    for (const std::optional<double>& value : camera.initial) {
      if (value) RequireFinite("initial values", {&*value, 1});
    }
  }
  if (session.target.keys) static_cast<void>(ReadTarget(session.target));
}

void CheckTarget(const Target& target) {
  for (const auto& [number, position] : target.markers) RequireFiniteMatrix("markers", position);
  const std::vector<TargetHypothesis> hypotheses = DoubtsAbout(target).hypotheses;
  // More markers in 60 other layouts, and in a YAML file, take this reader's time.
  constexpr size_t kMost = 10'000;
  if (target.markers.size() > kMost) return;
  for (const TargetHypothesis& hypothesis : hypotheses) {
    for (const auto& [number, places] : hypothesis.places()) {
      for (const Eigen::Vector3d& place : places) RequireFiniteMatrix("places", place);
    }
  }
  const std::string refined =
      RefinedTargetYaml(target, target.markers, NominalTarget(target).markers);
  RequireReadable("refined.yaml", refined.substr(0, refined.find("\nsigma:") + 1), [](auto& path) {
    ReadTarget(path);
  });
}

// A word that users type, in place of a file.
void ReadTargetWord(const fs::path& path) { CheckTarget(TargetOfWord(ContentOf(path))); }

void CheckCameras(const std::vector<CalibratedCamera>& cameras) {
  for (const CalibratedCamera& camera : cameras) {
    RequireFinite("parameters", camera.params);
    RequireFinite("config values", camera.config);
    RequireFinitePose(camera.T_camera_rig);
  }
  RequireReadable("again.yaml", GivenCamerasYaml(cameras, {}), [](const fs::path& path) {
    ReadCalibration(path, CameraModels());
  });
}

void ReadCalibrationFile(const fs::path& path) {
  CheckCameras(ReadCalibration(path, CameraModels()).cameras);
}

void ReadSpecFile(const fs::path& path) {
  for (const auto& camera : simulate::ReadSimulationSpec(path, CameraModels()).cameras) {
    RequireFinite("parameters", camera.params);
    RequireFinitePose(camera.T_camera_rig);
  }
}

// ---- tables

const CameraModel& ModelNamed(std::string_view name) { return *FindModel(CameraModels(), name); }

void ReadDetectionsOf(const CameraModel& model, const fs::path& path) {
  const std::vector<View> views = ReadDetections(path, model);
  for (const View& view : views) {
    for (const Observation& seen : view.observations) RequireFinite("coordinates", seen.values);
    for (const auto& errors : view.by_nuisance) RequireFinite("shared errors", errors);
  }
}

// What the rows of view_poses.csv and residuals.csv refer to.
CalibrationRecord SmallRecord() {
  CalibrationRecord record;
  for (const char* name : {"left", "plenoptic"}) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = &ModelNamed(camera.name == "left" ? "pinhole-radtan" : "focused-plenoptic");
  }
  for (const char* name : {"00", "01"}) record.frames.push_back({.name = name, .T_target_rig = {}});
  for (int marker = 0; marker < 4; ++marker) record.markers[marker] = {};
  return record;
}

void ReadPosesFile(const fs::path& path) {
  for (const FrameRecord& frame : ReadPoses(path)) RequireFinitePose(frame.T_target_rig);
}

void ReadViewPosesFile(const fs::path& path) {
  CalibrationRecord record = SmallRecord();
  ReadViewPoses(path, &record);
  for (const CalibratedCamera& camera : record.cameras) {
    for (const auto& [frame, view] : camera.view_poses) RequireFinitePose(view.T_target_rig);
  }
}

void ReadResidualsFile(const fs::path& path) {
  CalibrationRecord record = SmallRecord();
  ReadResiduals(path, &record);
  for (const CalibratedCamera& camera : record.cameras) {
    for (const ResidualRow& row : camera.residuals) {
      RequireFinite("coordinates", row.values);
      if (row.used) RequireFinite("residuals", row.residual);
    }
  }
}

void ReadCorrelationsFile(const fs::path& path) {
  RequireFiniteMatrix("correlations", ReadCorrelations(path).matrix);
}

void ReadScenePointsFile(const fs::path& path) {
  for (const auto& [number, point] : ReadScenePoints(path)) RequireFiniteMatrix("points", point);
}

void ReadGroundTruthFile(const fs::path& path) {
  const TruthUncertainty truth = ReadGroundTruth(path, {}).uncertainty;
  RequireFiniteMatrix("covariances", truth.covariance.segments);
  const std::vector<Eigen::Vector3d> origin{Eigen::Vector3d::Zero()};
  const PathSegment start{.positions = {}, .centre = truth.start_centre};
  const PathSegment end{.positions = {}, .centre = truth.end_centre};
  RequireFinite("floors",
                std::vector{truth.covariance.AlignmentFloor(start, end, origin),
                            std::sqrt(truth.covariance.scale_sigma)});
}

void CheckMicroLenses(const MicroLensArray& array) {
  for (const Eigen::Vector2d& e : {array.e_column, array.e_row}) {
    RequireFiniteMatrix("lattice vectors", e);
  }
  for (const MicroLens& lens : array.lenses) RequireFiniteMatrix("centres", lens.centre);
}

void ReadMicroLensFile(const fs::path& path) {
  CheckMicroLenses(ReadMicroLenses(path, kImageSize));
}

void ReadLatticeFile(const fs::path& path) {
  RequireFiniteMatrix("root of the lattice's errors", ReadLatticeErrors(path, kImageSize).Root());
}

void CheckTrajectory(const Trajectory& trajectory) {
  RequireFinite("times", trajectory.times);
  for (const auto& position : trajectory.positions) RequireFiniteMatrix("positions", position);
  for (const auto& q : trajectory.orientations) RequireFiniteMatrix("quaternions", q.coeffs());
}

void ReadTimesFile(const fs::path& path) {
  constexpr const char* kPoses = "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n";
  CheckTrajectory(ReadTrajectory(FolderOfRun().Write("poses.txt", kPoses), path));
}

// ---- recordings

// The images are not there: what the file says is read.
void ReadRecordingYaml(const fs::path& path) {
  for (const RecordedFiles& camera : ReadRecordingFile(path).cameras) {
    if (camera.pixel_size) RequireFinite("pixel sizes", std::vector{*camera.pixel_size});
  }
}

void ReadImageTimesFile(const fs::path& path) {
  for (const ImageTime& row : ReadImageTimes(path, ExposureUnit::kMilliseconds).rows) {
    RequireFinite("times", std::vector{row.time, row.exposure.value_or(0)});
  }
}

// Tracks of scene points in three images.
void ReadTracks(const fs::path& path) {
  Recording recording;
  RecordedCamera& camera = recording.cameras.emplace_back();
  camera.name = "left";
  camera.markers =
      MarkerFile{.path = path, .columns = {"frame", "marker", "x", "y", "sigma"}, .skip = 1};
  for (const size_t image : {0, 1, 2}) {
    const std::string name = fmt::format("{:04}", image);
    camera.images.push_back({{.frame = name, .path = name + ".png"}});
    recording.frames.push_back({.name = name, .time = 0, .image = {image}});
  }
  const SuppliedDetections tracks = ReadSuppliedDetections(recording, 0);
  RequireReadable("tracks.csv", tracks.csv, [](const fs::path& file) {
    ReadDetectionsOf(ModelNamed("pinhole"), file);
  });
}

void ReadArchive(const fs::path& path) {
  const ZipArchive archive(path);
  for (size_t i = 0; i < archive.Names().size(); ++i) static_cast<void>(archive.Read(i));
}

// ---- files of other tools

void ReadCamerasOf(const CameraFormat& format, const fs::path& path) {
  std::vector<CalibratedCamera> cameras = ReadCameraFile(format, {path, kImageSize});
  for (size_t i = 0; i < cameras.size(); ++i) cameras[i].name = fmt::format("camera{}", i);
  MakeFirstMaster(&cameras);
  CheckCameras(cameras);
}

void ReadImportFile(const ImportFormat& format, const fs::path& path) {
  const ImportedFile made = format.read({path, kImageSize});
  RequireReadable("made", made.content, [&](const fs::path& file) {
    if (format.result == "target.yaml") {
      ReadTarget(file);
    } else if (format.result.starts_with("detections")) {
      ReadDetections(file, ModelNamed("pinhole"));
    } else {
      ReadMicroLenses(file, kImageSize);
    }
  });
}

void ReadColmapImagesOf(const fs::path& path) {
  for (const ColmapImage& image : ReadColmapImages(path)) {
    for (const ColmapObservation& seen : image.observations) {
      RequireFinite("coordinates", std::vector{seen.x, seen.y});
    }
  }
}

// ---- images, cache, plug-ins, command line

void ReadImageFile(const fs::path& path) {
  const int orientation = ReadOrientation({.frame = {}, .path = path});
  if (orientation < 1 || orientation > 8) throw std::logic_error("an orientation that is none");
  static_cast<void>(ReadGray(path));
}

/// All images of all topics, and the intrinsics beside them.
void ReadMessages(const fs::path& path) {
  const auto log = std::make_shared<const MessageLog>(path);
  for (const ImageTopic& topic : log->ImageTopics()) {
    if (!topic.camera_info.empty()) {
      const std::optional<CameraInfo> info = log->ReadInfo(topic.camera_info);
      if (info) static_cast<void>(RosCameraYaml(*info, "camera"));
    }
    std::vector<std::string> notes;
    for (const FrameImage& image : log->Images(topic.name, &notes)) {
      try {
        static_cast<void>(ReadGray(image));
      } catch (const Error&) {
        continue;  // one image alone is damaged
      }
    }
  }
}

void ReadAttenuationFile(const fs::path& path) {
  if (!cv::checkRange(ReadAttenuation(path))) throw std::logic_error("attenuations that are none");
}

void ReadCacheEntry(const fs::path& path) {
  DetectionCache cache(path.parent_path(), "program", /*fresh=*/false);
  static_cast<void>(cache.Load(path.filename().string()));
  const std::string content = ContentOf(path);
  static_cast<void>(internal::UnpackMicroLenses(content));
  static_cast<void>(UnpackEntry<internal::RawDetections>(content));
  static_cast<void>(UnpackEntry<internal::Pictures>(content));
  static_cast<void>(UnpackEntry<SampleView>(content));
}

// What stands before the system's loader, which would run the file's code.
void ReadPlugin(const fs::path& path) { static_cast<void>(internal::WhyNotLoadable(path)); }

// One argument a line; the command is not run.
void ReadCommandLine(const fs::path& path) {
  std::istringstream text(ContentOf(path));
  std::vector<std::string> words{"plenocal"};
  for (std::string word; std::getline(text, word);) {
    // Both end in text on the terminal.
    if (word == "--version" || word.starts_with("--help") || word.starts_with("-h")) return;
    words.push_back(word);
  }
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  CommandLine command_line;
  command_line.Parse(static_cast<int>(words.size()), arguments.data());
}

std::vector<Reader> MakeReaders() {
  const auto detections_of = [](std::string_view model) {
    return [model](const fs::path& path) { ReadDetectionsOf(ModelNamed(model), path); };
  };
  const auto target = [](const fs::path& path) { CheckTarget(ReadTarget(path)); };
  const auto trajectory = [](const fs::path& path) { CheckTrajectory(ReadTrajectory(path, {})); };
  std::vector<Reader> readers{
      {"session", "session.yaml", ReadSessionFile},
      {"target", "target.yaml", target},
      {"target_word", "word", ReadTargetWord, /*names_file=*/false},
      {"calibration", "calibration.yaml", ReadCalibrationFile},
      {"simulation", "spec.yaml", ReadSpecFile},
      {"detections", "detections.csv", detections_of("pinhole-radtan")},
      {"plenoptic_detections", "detections.csv", detections_of("focused-plenoptic")},
      {"poses", "poses.csv", ReadPosesFile},
      {"view_poses", "view_poses.csv", ReadViewPosesFile},
      {"residuals", "residuals.csv", ReadResidualsFile},
      {"correlations", "correlations.csv", ReadCorrelationsFile},
      {"scene_points", "points.csv", ReadScenePointsFile},
      {"groundtruth", "groundtruth.yaml", ReadGroundTruthFile},
      {"micro_lenses", "micro_lenses.csv", ReadMicroLensFile},
      {"lattice", "lattice.yaml", ReadLatticeFile},
      {"trajectory", "trajectory.txt", trajectory},
      {"trajectory_times", "times.txt", ReadTimesFile},
      {"recording", "recording.yaml", ReadRecordingYaml},
      {"recording_times", "times.txt", ReadImageTimesFile},
      {"recording_euroc", "data.csv", ReadImageTimesFile},
      {"recording_tracks", "tracks.csv", ReadTracks},
      {"recording_zip", "images.zip", ReadArchive},
      {"recording_mcap", "drive.mcap", ReadMessages},
      {"recording_bag", "drive.bag", ReadMessages},
      {"recording_db3", "drive.db3", ReadMessages},
      {"colmap_images", "images.txt", ReadColmapImagesOf},
      {"colmap_images_binary", "images.bin", ReadColmapImagesOf},
      {"colmap_cameras_binary",
       "cameras.bin",
       [](const fs::path& path) { ReadCamerasOf(*FindCameraFormat("colmap", path), path); }},
      {"image", "image", ReadImageFile},
      {"response",
       "pcalib.txt",
       [](const fs::path& path) { RequireFinite("light", ReadResponse(path).Values()); }},
      {"attenuation", "attenuation.tiff", ReadAttenuationFile},
      {"cache", "entry", ReadCacheEntry, /*names_file=*/false},
      {"plugin", "libplugin.so", ReadPlugin},
      {"fleet_plan", "plan.yaml", [](const fs::path& path) { ReadFleetPlan(path); }},
      {"command_line", "arguments", ReadCommandLine, /*names_file=*/false},
      {"workbench_request", "request", AnswerWorkbenchRequest, /*names_file=*/false}};
  for (const CameraFormat& format : CameraFormats()) {
    readers.push_back({fmt::format("camera_{}", format.name),
                       std::string(format.file),
                       [&format](const fs::path& path) { ReadCamerasOf(format, path); }});
  }
  for (const ImportFormat& format : ImportFormats()) {
    if (format.result == "session.yaml") continue;  // of a folder, whose files are read above
    readers.push_back({fmt::format("import_{}", format.name),
                       "imported",
                       [&format](const fs::path& path) { ReadImportFile(format, path); }});
  }
  std::ranges::move(Commands(), std::back_inserter(readers));
  return readers;
}

}  // namespace

std::string ContentOf(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

const std::vector<Reader>& Readers() {
  static const std::vector<Reader> readers = MakeReaders();
  return readers;
}

const Reader& FindReader(std::string_view name) {
  const auto found = std::ranges::find(Readers(), name, &Reader::name);
  if (found != Readers().end()) return *found;
  std::string names;
  for (const Reader& reader : Readers()) names += " " + reader.name;
  throw std::logic_error(fmt::format("no reader '{}'; there are:{}", name, names));
}

bool Read(const Reader& reader, std::string_view input) {
  const fs::path path = FolderOfRun().Write(reader.file, input);
  try {
    reader.read(path);
    return true;
  } catch (const Error& error) {
    const std::string_view message = error.what();
    if (reader.names_file && !message.starts_with(path.string())) {
      throw std::logic_error(fmt::format("a refusal that does not name the file: {}", message));
    }
    return false;
  }
}

}  // namespace plenocal::fuzz
