// SPDX-License-Identifier: Apache-2.0
//
// cameras.txt of COLMAP, "ID MODEL WIDTH HEIGHT PARAMS"; cameras.bin is read as well. In a folder:
// a whole model, with the images' poses and the points.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <map>
#include <numbers>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/colmap_files.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/word_lines.h"

namespace plenocal {
namespace {

const LensTable& ColmapLenses() {
  static const LensTable kTable{
      .tool = "colmap",
      .forms = {{"pinhole", "PINHOLE", ""},
                {"pinhole-radial3", "FULL_OPENCV", "A_0 A_1 0 0 A_2 0 0 0"},
                {"pinhole-radial3", "OPENCV", "A_0 A_1 0 0"},
                {"pinhole-radtan4", "OPENCV", "k_1 k_2 p_1 p_2"},
                {"pinhole-radtan", "FULL_OPENCV", "k_1 k_2 p_1 p_2 k_3 0 0 0"},
                {"pinhole-radtan8", "FULL_OPENCV", "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6"},
                {"equidistant", "FISHEYE", ""},
                {"kannala-brandt4", "OPENCV_FISHEYE", "k_1 k_2 k_3 k_4"},
                {"equidistant+thin-prism", "THIN_PRISM_FISHEYE", "k_1 k_2 p_1 p_2 k_3 k_4 s_1 s_3"},
                // Its tangential coefficients are in the other order.
                {"equidistant+radial6+prism",
                 "RAD_TAN_THIN_PRISM_FISHEYE",
                 "k_1 k_2 k_3 k_4 k_5 k_6 p_2 p_1 s_1 s_2 s_3 s_4"},
                {"fov", "FOV", "omega"},
                {"division", "DIVISION", "lambda"},
                {"eucm", "EUCM", "alpha beta"}},
      .first_pixel = kColmapPixelCentre};
  return kTable;
}

constexpr const char* kEquirectangular = "EQUIRECTANGULAR";

/// Its parameters are the size of the image.
std::array<double, 4> ColmapPanorama(double width, double height) {
  return {width / (2 * std::numbers::pi),
          height / std::numbers::pi,
          width / 2 - kColmapPixelCentre,
          height / 2 - kColmapPixelCentre};
}

std::string WriteColmap(const std::vector<CalibratedCamera>& cameras) {
  std::string text =
      "# Camera list with one line of data per camera:\n"
      "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  text += fmt::format("# Number of cameras: {}\n", cameras.size());
  for (size_t i = 0; i < cameras.size(); ++i) {
    const auto [width, height] = cameras[i].image_size;
    std::string name = kEquirectangular;
    std::vector<double> numbers{static_cast<double>(width), static_cast<double>(height)};
    if (cameras[i].model->name == "spherical") {
      CheckPanorama(cameras[i], ColmapPanorama(width, height), "colmap");
    } else {
      const Lens lens = ToLens(cameras[i], ColmapLenses());
      name = lens.name;
      numbers = lens.Numbers();
    }
    text += fmt::format("{} {} {} {} {}\n", i + 1, name, width, height, BlankSeparated(numbers));
  }
  return text;
}

/// Images and points as text; files of a model refer to each other by these numbers and by the
/// order of an image's points.
struct ModelText {
  std::string images =
      "# Image list with two lines of data per image:\n"
      "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "#   POINTS2D[] as (X, Y, POINT3D_ID)\n";
  struct Track {
    std::string images;     ///< " IMAGE POINT2D_INDEX" of each
    double sum_errors = 0;  ///< px
    int count = 0;
  };
  std::map<int, Track> tracks;  ///< by marker
  int image_count = 0;

  /// Adds the frames in which the camera shows markers.
  void AddCamera(const CalibrationRecord& calibration, size_t camera, size_t id, bool in_folder);
  [[nodiscard]] std::string Points(const CalibrationRecord& calibration) const;
};

void ModelText::AddCamera(const CalibrationRecord& calibration,
                          size_t camera,
                          size_t id,
                          bool in_folder) {
  const CalibratedCamera& from = calibration.cameras[camera];
  std::map<int, std::vector<const ResidualRow*>> seen;
  for (const ResidualRow& row : from.residuals) {
    if (row.used) seen[row.frame].push_back(&row);
  }
  for (const auto& [frame, rows] : seen) {
    const RigidTransform T = calibration.CameraFromTarget(camera, frame);
    const Eigen::Quaterniond q(T.R);
    images += fmt::format(
        "{} {} {} {}{}.png\n",
        ++image_count,
        BlankSeparated(std::array{q.w(), q.x(), q.y(), q.z(), T.t.x(), T.t.y(), T.t.z()}),
        id,
        in_folder ? from.name + "/" : std::string(),
        calibration.frames[static_cast<size_t>(frame)].name);
    for (size_t i = 0; i < rows.size(); ++i) {
      images += fmt::format("{}{} {} {}",
                            i == 0 ? "" : " ",
                            RealText(rows[i]->values[0] + kColmapPixelCentre),
                            RealText(rows[i]->values[1] + kColmapPixelCentre),
                            rows[i]->marker);
      Track& track = tracks[rows[i]->marker];
      track.images += fmt::format(" {} {}", image_count, i);
      const double error = rows[i]->Error().norm();
      if (!std::isfinite(error)) continue;  // not imaged
      track.sum_errors += error;
      ++track.count;
    }
    images += "\n";
  }
}

std::string ModelText::Points(const CalibrationRecord& calibration) const {
  constexpr double kUnknownError = -1;  // COLMAP's
  std::string text =
      "# 3D point list with one line of data per point:\n"
      "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
  for (const auto& [marker, track] : tracks) {
    const Eigen::Vector3d& p = calibration.markers.at(marker).position;
    text += fmt::format("{} {} 128 128 128 {}{}\n",
                        marker,
                        BlankSeparated(std::array{p.x(), p.y(), p.z()}),
                        RealText(track.count > 0 ? track.sum_errors / track.count : kUnknownError),
                        track.images);
  }
  return text;
}

std::vector<std::pair<std::string, std::string>> WriteModel(const CalibrationRecord& calibration,
                                                            const std::vector<size_t>& cameras) {
  std::vector<CalibratedCamera> chosen;
  ModelText model;
  for (const size_t camera : cameras) {
    chosen.push_back(calibration.cameras[camera]);
    model.AddCamera(calibration, camera, chosen.size(), cameras.size() > 1);
  }
  return {{"cameras.txt", WriteColmap(chosen)},
          {"images.txt", model.images},
          {"points3D.txt", model.Points(calibration)}};
}

std::vector<CalibratedCamera> ReadColmap(const CameraSource& source) {
  std::vector<CalibratedCamera> cameras;
  for (ColmapCamera& camera : ReadColmapCameras(source.path)) {
    std::string& name = camera.model;
    std::vector<double>& values = camera.params;
    if (name == kEquirectangular) {
      cameras.push_back(PanoramaCamera(camera.image_size, ColmapPanorama(values[0], values[1])));
      cameras.back().name = fmt::format("camera{}", camera.id);
      continue;
    }
    // Models with one focal length, by the name of the same model with two.
    static const std::map<std::string_view, const char*> kSimple{
        {"SIMPLE_PINHOLE", "PINHOLE"},
        {"SIMPLE_RADIAL", "OPENCV"},
        {"RADIAL", "OPENCV"},
        {"SIMPLE_FISHEYE", "FISHEYE"},
        {"SIMPLE_RADIAL_FISHEYE", "OPENCV_FISHEYE"},
        {"RADIAL_FISHEYE", "OPENCV_FISHEYE"},
        {"SIMPLE_DIVISION", "DIVISION"}};
    if (const auto simple = kSimple.find(name); simple != kSimple.end()) {
      values.insert(values.begin(), values[0]);
      name = simple->second;
    }
    if (values.size() < 4) throw InputError("{}: expected at least fx, fy, cx, cy", camera.where);
    cameras.push_back(
        FromLens(LensOfNumbers(name, values), camera.image_size, ColmapLenses(), camera.where));
    cameras.back().name = fmt::format("camera{}", camera.id);
  }
  return cameras;
}

}  // namespace

CameraFormat ColmapFormat() {
  return {.name = "colmap",
          .file = "cameras.txt",
          .most_cameras = kAnyNumber,
          .write = WriteColmap,
          .read = ReadColmap,
          .write_model = WriteModel};
}

}  // namespace plenocal
