// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "detectors/images/attenuation.h"
#include "detectors/images/image.h"
#include "detectors/images/image_header.h"
#include "engine/recording/layouts.h"
#include "engine/recording/recorded_frames.h"
#include "engine/recording/recording.h"
#include "engine/recording/stores/image_index.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {
namespace {

void LeaveOut(const std::string& camera,
              const std::string& where,
              const std::string& image,
              const std::string& reason,
              std::vector<LeftOut>* left_out) {
  left_out->push_back(
      {.where = where, .reason = reason, .whole = true, .camera = camera, .frame = image});
}

// ---- times

void AssignInOrder(const ImageTimes& times,
                   const std::string& camera,
                   std::vector<RecordedImage>* images) {
  if (times.rows.size() != images->size()) {
    throw InputError(
        "{}: has {} times, but camera {} has {} images; times without names of "
        "images must be one per image",
        times.path.string(),
        times.rows.size(),
        camera,
        images->size());
  }
  for (size_t i = 0; i < images->size(); ++i) (*images)[i].time = times.rows[i].time;
}

void AssignByName(const ImageTimes& times,
                  const std::string& camera,
                  std::vector<RecordedImage>* images,
                  std::vector<LeftOut>* left_out) {
  const ImageIndex index({images->begin(), images->end()});
  std::vector<int> line_of(images->size(), 0);
  for (const ImageTime& row : times.rows) {
    const std::optional<size_t> found = index.Find(row.id);
    const std::string where = fmt::format("{}:{}", times.path.string(), row.line);
    if (!found) {
      LeaveOut(camera, where, row.id, "has a time, but there is no such image", left_out);
      continue;
    }
    int& line = line_of[*found];
    if (line != 0) {
      throw InputError(
          "{}: image '{}' has a time in line {} already; remove one of them", where, row.id, line);
    }
    line = row.line;
    (*images)[*found].time = row.time;
    (*images)[*found].exposure = row.exposure;
  }
  if (std::ranges::all_of(line_of, [](int line) { return line == 0; })) {
    throw InputError(
        "{}: names no image of camera {}: it has '{}', the images are called '{}'; "
        "is it the right file?",
        times.path.string(),
        camera,
        times.rows[0].id,
        images->front().frame);
  }
}

/// Exposures that the camera did not give, from the neighbours in time. Returns their number.
size_t FillExposures(std::vector<RecordedImage>* images) {
  std::vector<size_t> known;
  for (size_t i = 0; i < images->size(); ++i) {
    if ((*images)[i].exposure) known.push_back(i);
  }
  if (known.empty()) return 0;
  for (size_t i = 0; i < images->size(); ++i) {
    const auto after = std::ranges::lower_bound(known, i);
    if (after != known.end() && *after == i) continue;
    // At the ends there is one neighbour.
    const size_t next = after == known.end() ? known.back() : *after;
    const size_t before = after == known.begin() ? known.front() : *std::prev(after);
    (*images)[i].exposure = (*(*images)[before].exposure + *(*images)[next].exposure) / 2;
  }
  return images->size() - known.size();
}

/// Replaces the exposures that the table has of the camera's images.
void TakeExposures(const std::filesystem::path& table, RecordedCamera* camera) {
  const auto exposures = ReadExposureTable(table);
  bool found = false;
  for (RecordedImage& image : camera->images) {
    const auto row = exposures.find({camera->name, image.frame});
    if (row == exposures.end()) continue;
    image.exposure = row->second;
    found = true;
  }
  const bool named = std::ranges::any_of(
      exposures, [&](const auto& row) { return row.first.first == camera->name; });
  if (found || !named) return;
  throw InputError(
      "{}: names no image of camera {}: the images are called '{}'; is it the "
      "right file?",
      table.string(),
      camera->name,
      camera->images.front().frame);
}

/// Removes the images for which reason(i) is not empty.
template <typename Reason>
void RemoveImages(const std::string& camera,
                  const Reason& reason,
                  std::vector<RecordedImage>* images,
                  std::vector<LeftOut>* left_out) {
  std::vector<RecordedImage> kept;
  for (size_t i = 0; i < images->size(); ++i) {
    RecordedImage& image = (*images)[i];
    if (const std::string why = reason(i); !why.empty()) {
      LeaveOut(camera, image.path.string(), image.frame, why, left_out);
    } else {
      kept.push_back(std::move(image));
    }
  }
  *images = std::move(kept);
}

void AssignTimes(const RecordedFiles& source,
                 std::vector<RecordedImage>* images,
                 std::vector<LeftOut>* left_out) {
  const ImageTimes times = ReadImageTimes(source.times, source.exposure_unit);
  if (!times.has_ids) {
    AssignInOrder(times, source.name, images);
    return;
  }
  AssignByName(times, source.name, images, left_out);
  const std::string untimed = fmt::format("has no time in {}", source.times.string());
  RemoveImages(
      source.name,
      [&](size_t i) { return (*images)[i].time ? std::string() : untimed; },
      images,
      left_out);
  std::ranges::stable_sort(*images, {}, [](const RecordedImage& image) { return *image.time; });
}

// ---- sizes

/// From the header: of most files it is in the first part.
std::optional<ImageSize> HeaderSizeOf(const FrameImage& image) {
  constexpr size_t kStart = 1 << 14;  // bytes
  constexpr size_t kWhole = std::numeric_limits<size_t>::max();
  for (const size_t most : {kStart, kWhole}) {
    StoredImage start;
    if (image.store) {
      start = image.store->Start(image.index, most);
    } else {
      const std::string content = most == kStart ? ReadInputStart(image.path, most)
                                                 : ReadInput(image.path, InputLimit::kImage);
      start.bytes.assign(content.begin(), content.end());
    }
    if (!start.encoding.empty()) return start.size;
    const std::optional<ImageSize> size = SizeInHeader(start.bytes);
    if (size || !HasSizeFurtherBack(start.bytes)) return size;
  }
  return std::nullopt;
}

/// Leaves out images whose size is not that of most; returns this size.
ImageSize KeepOneSize(const RecordedFiles& camera,
                      std::vector<RecordedImage>* images,
                      std::vector<LeftOut>* left_out) {
  std::vector<std::string> defects(images->size());
  std::vector<ImageSize> sizes(images->size());
  std::map<ImageSize, size_t> counts;
  for (size_t i = 0; i < images->size(); ++i) {
    try {
      const std::optional<ImageSize> size = HeaderSizeOf((*images)[i]);
      if (!size) defects[i] = "is no image, or damaged at its beginning";
      if (size) ++counts[sizes[i] = *size];
    } catch (const Error& error) {
      defects[i] = WithoutPath(error.what(), (*images)[i].path);
    }
  }
  if (counts.empty()) {
    throw InputError("{}: none of {} files is an image that can be read; the first, {}, {}",
                     camera.where,
                     images->size(),
                     images->front().path.string(),
                     defects[0]);
  }
  const auto usual = std::ranges::max_element(counts, {}, [](const auto& c) { return c.second; });
  const ImageSize size = usual->first;
  RemoveImages(
      camera.name,
      [&](size_t i) {
        if (!defects[i].empty() || sizes[i] == size) return defects[i];
        return fmt::format(
            "has {} px, most have {}", fmt::join(sizes[i], " x "), fmt::join(size, " x "));
      },
      images,
      left_out);
  return size;
}

// ---- raw mosaics

/// `PlaneDifference` of the image relative to its surroundings: a brightness that rises along the
/// image would differ between the planes too. The weights 1 2 1 take all four planes alike.
double MosaicDifference(const cv::Mat& grey) {
  cv::Mat image, level;
  grey.convertTo(image, CV_32F);
  cv::GaussianBlur(image, level, {3, 3}, 0, 0, cv::BORDER_REFLECT_101);
  cv::max(level, 1, level);
  return PlaneDifference(image / level);
}

/// Refuses a mosaic that would be taken for a grey image: its 2 x 2 raster is edges everywhere.
void RefuseMosaic(const RecordedFiles& source, const RecordedCamera& camera) {
  if (camera.bayer) return;
  double least = 1;
  bool seen = false;
  const size_t last = camera.images.size() - 1;
  for (const size_t index : std::set<size_t>{0, last / 2, last}) {
    try {
      least = std::min(least, MosaicDifference(camera.Read(index)));
      seen = true;
    } catch (const Error&) {
      continue;  // a damaged image is refused where it is used
    }
  }
  if (!seen || least == 0) return;
  throw InputError(
      "{}: the images of camera {} are raw colour mosaics (the four pixels of their 2 "
      "x 2 raster differ by {:.0f} %); state the order of colours in recording.yaml, "
      "such as 'bayer: RGGB', or convert them to grey",
      source.where,
      camera.name,
      100 * least);
}

// ---- cameras

RecordedCamera ReadRecordedCamera(const RecordedFiles& source,
                                  ImageLister* lister,
                                  std::vector<LeftOut>* left_out) {
  if (source.images.empty()) {
    throw InputError("{}: has tracks and no images; `plenocal groundtruth` takes the tracks",
                     source.where);
  }
  RecordedCamera camera{source};
  std::vector<RecordedImage>& images = camera.images;
  for (FrameImage& image : lister->List(source.images, source.where)) {
    images.push_back({std::move(image)});
  }
  std::ranges::stable_sort(images, NaturalLess, &RecordedImage::frame);
  if (!source.times.empty()) AssignTimes(source, &images, left_out);
  camera.exposures_filled = FillExposures(&images);
  camera.image_size = KeepOneSize(source, &images, left_out);
  if (!source.white_images.empty()) {
    camera.white_images = ListImages(source.white_images, source.name + ": white images");
  }
  RefuseMosaic(source, camera);
  return camera;
}

/// Names of folders are not checked by whoever made them.
void CheckCameraNames(const RecordingFile& file) {
  std::set<std::string> names;
  for (const RecordedFiles& camera : file.cameras) {
    const auto defect = CameraNameDefect(camera.name);
    if (defect || !names.insert(camera.name).second) {
      throw InputError(
          "{}: the name of the camera, '{}', {}; write a recording.yaml with "
          "the names of the cameras",
          camera.where,
          camera.name,
          defect.value_or("is that of another one too"));
    }
  }
}

}  // namespace

Recording ReadRecording(const std::filesystem::path& path) {
  CompleteResults(path);
  const RecordingFile file = FindRecordingFile(path);
  CheckCameraNames(file);
  if (!file.calibration.empty()) CompleteResults(file.calibration);
  Recording recording{file};
  ImageLister lister;
  if (file.log) lister.Use(file.log);
  for (const RecordedFiles& camera : file.cameras) {
    recording.cameras.push_back(ReadRecordedCamera(camera, &lister, &recording.left_out));
    if (!file.exposures.empty()) TakeExposures(file.exposures, &recording.cameras.back());
  }
  recording.notes = lister.Notes();
  MakeFrames(file.pairing, &recording);
  return recording;
}

}  // namespace plenocal
