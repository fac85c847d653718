// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/supplied_detections.h"

#include <fmt/format.h>

#include <array>
#include <map>
#include <string_view>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/detections.h"
#include "calib/io/csv.h"
#include "calib/io/input_file.h"
#include "engine/recording/stores/image_index.h"
#include "engine/recording/stores/message_log.h"

namespace plenocal {
namespace {

constexpr int kMarkerDecimals = 8;  // as all detections are written

/// Names of the frames that a camera's images are part of, by image.
std::vector<std::string> FrameNames(const Recording& recording, size_t camera) {
  std::vector<std::string> names(recording.cameras[camera].images.size());
  for (const RecordedFrame& frame : recording.frames) {
    if (frame.image[camera]) names[*frame.image[camera]] = frame.name;
  }
  return names;
}

/// The rows of a file of markers as those of a detections CSV.
class MarkerRows {
 public:
  MarkerRows(const MarkerFile& file, std::string_view text)
      : file_(file),
        table_(text,
               file.path.string(),
               FirstRow(text, file.skip).find(',') == std::string_view::npos ? CsvSyntax::kVnlog
                                                                             : CsvSyntax::kCsv,
               {.names = file.columns, .skip = file.skip}),
        frame_(table_.Column("frame")),
        marker_(table_.Column("marker")) {
    for (const std::string_view name : kCoordinates) {
      if (const auto column = table_.Find(name)) coordinates_.push_back(*column);
    }
    sigma_ = table_.Find("sigma");
  }

  [[nodiscard]] std::string Header() const {
    std::string header = "frame,marker";
    for (const size_t column : coordinates_) header.append(",").append(table_.Header()[column]);
    return header + (sigma_ ? ",sigma\n" : "\n");
  }
  bool Next() { return table_.Next(); }
  [[nodiscard]] int Line() const { return table_.Line(); }
  [[nodiscard]] std::string Frame() const { return std::string(table_.Text(frame_)); }

  /// The present row, of the frame of this name.
  std::string Row(const std::string& frame) {
    std::string key = fmt::format("{},{}", CsvCell(frame), table_.Integer(marker_)), row = key;
    for (size_t i = 0; i < coordinates_.size(); ++i) {
      std::string cell = ",";
      AppendFixed(table_.Number(coordinates_[i]) - file_.pixel_origin, kMarkerDecimals, &cell);
      row += cell;
      if (i >= kMeasured) key += cell;
    }
    const auto [place, is_new] = line_of_.emplace(key, table_.Line());
    if (!is_new) {
      table_.Fail(fmt::format("frame '{}' has this marker in line {} already; keep one of the rows",
                              frame,
                              place->second));
    }
    if (sigma_) row.append(",").append(Sigma());
    return row + '\n';
  }

 private:
  static constexpr std::array<std::string_view, 4> kCoordinates{"x", "y", "lens_x", "lens_y"};
  static constexpr size_t kMeasured = 2;  // x and y; the others are the micro lens' centre

  [[nodiscard]] std::string Sigma() const {
    const std::optional<double> sigma = table_.NumberIfAny(*sigma_);
    if (sigma && !(*sigma > 0 && std::isnormal(*sigma * *sigma))) {
      table_.FailAt(*sigma_, "expected a positive number from 1e-150 to 1e150");
    }
    return std::string(table_.Text(*sigma_));
  }

  const MarkerFile& file_;
  CsvReader table_;
  size_t frame_, marker_;
  std::vector<size_t> coordinates_;
  std::optional<size_t> sigma_;
  std::map<std::string, int> line_of_;
};

}  // namespace

SuppliedDetections ReadSuppliedDetections(const Recording& recording, size_t camera) {
  const RecordedCamera& recorded = recording.cameras[camera];
  const std::vector<std::string> frames = FrameNames(recording, camera);
  const ImageIndex index({recorded.images.begin(), recorded.images.end()});
  const std::string text = ReadTextFile(recorded.markers->path);
  MarkerRows rows(*recorded.markers, text);
  SuppliedDetections detections{.csv = rows.Header()};
  while (rows.Next()) {
    if (const std::optional<size_t> image = index.Find(rows.Frame())) {
      detections.csv += rows.Row(frames[*image]);
      ++detections.points;
    } else if (detections.left_out++ == 0) {
      detections.first_left_out = rows.Line();
    }
  }
  if (detections.points > 0) return detections;
  throw InputError(
      "{}: names no image of camera {} in its column 'frame'; are 'columns' and "
      "'skip' right?",
      recorded.markers->path.string(),
      recorded.name);
}

OutputContents SuppliedMarkers(const Recording& recording, const Run& run) {
  OutputContents files;
  for (size_t c = 0; c < recording.cameras.size(); ++c) {
    const RecordedCamera& camera = recording.cameras[c];
    if (!camera.markers) continue;
    const SuppliedDetections detections = ReadSuppliedDetections(recording, c);
    run.Message(fmt::format("{}: {}", camera.name, Counted(detections.points, "point")));
    if (detections.left_out > 0) {
      run.Warning(fmt::format("{}:{}: {} of images that the recording does not have",
                              camera.markers->path.string(),
                              detections.first_left_out,
                              Counted(detections.left_out, "row")));
    }
    files.emplace_back(DetectionsName(camera.name), detections.csv);
  }
  if (!files.empty()) return files;
  throw InputError(
      "{}: has no supplied detections; name them in recording.yaml: "
      "'markers: {{{}: {{file: markers.txt, columns: [frame, marker, x, y]}}}}'",
      recording.path.string(),
      recording.cameras[0].name);
}

OutputContents CameraInfoFiles(const Recording& recording, const Run& run) {
  OutputContents files;
  for (const ImageTopic& topic : recording.topics) {
    if (topic.camera_info.empty() || topic.camera.empty()) continue;
    const std::optional<CameraInfo> info = recording.log->ReadInfo(topic.camera_info);
    if (!info) continue;
    if (!(info->camera[0] > 0)) {
      run.Warning(fmt::format("{}: its focal length is {}: the driver had no calibration",
                              topic.camera_info,
                              info->camera[0]));
      continue;
    }
    files.emplace_back(fmt::format("camera_info_{}.yaml", topic.camera),
                       RosCameraYaml(*info, topic.camera));
  }
  if (!files.empty()) return files;
  throw InputError(
      "{}: has no camera_info with a calibration beside its images; 'plenocal "
      "recording' lists its topics",
      recording.path.string());
}

}  // namespace plenocal
