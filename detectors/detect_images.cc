// SPDX-License-Identifier: Apache-2.0
#include "detectors/detect_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>

#include "calib/error.h"
#include "calib/parallel.h"
#include "calib/stage_record.h"
#include "detectors/attenuation.h"
#include "detectors/detect_plenoptic.h"
#include "detectors/image.h"
#include "detectors/marker_detector.h"
#include "detectors/marker_picture.h"
#include "detectors/sample_picture.h"
#include "detectors/white_images.h"

namespace plenocal {
namespace {

struct ImageResult {
  ImageSize size{};
  MarkerDetections found;
  std::string unreadable;
  bool reused = false;
};

std::string Pack(const ImageResult& result) {
  StageWriter writer;
  for (const int length : result.size) writer.Put(length);
  writer.PutAll(result.found.markers, [&](const Observation& seen) { writer.Put(seen); });
  writer.PutAll(result.found.left_out, [&](const std::string& reason) { writer.Put(reason); });
  writer.Put(result.found.failure);
  const auto put = [&](const auto& matrix) {
    for (const double value : matrix.reshaped()) writer.Put(value);
  };
  writer.PutAll(result.found.readings, [&](const LensReading& reading) {
    put(reading.p);
    put(reading.along);
    writer.Put(reading.value);
    writer.Put(reading.variance);
  });
  writer.PutAll(result.found.bent, [&](const BentMarker& bent) {
    writer.PutAll(bent.pieces, [&](const BentPiece& piece) {
      put(piece.p);
      put(piece.bends);
      put(piece.by_bends);
    });
    writer.Put(bent.sigma);
  });
  return writer.Text();
}

std::optional<ImageResult> Unpack(const std::string& text) {
  StageReader reader(text);
  ImageResult result;
  result.reused = true;
  for (int& length : result.size) length = reader.Get<int>();
  reader.GetAll([&] { result.found.markers.push_back(reader.Get<Observation>()); });
  reader.GetAll([&] { result.found.left_out.push_back(reader.Get<std::string>()); });
  result.found.failure = reader.Get<std::string>();
  const auto get = [&](auto* matrix) {
    for (double& value : matrix->reshaped()) value = reader.Get<double>();
  };
  reader.GetAll([&] {
    LensReading& reading = result.found.readings.emplace_back();
    get(&reading.p);
    get(&reading.along);
    reading.value = reader.Get<double>();
    reading.variance = reader.Get<double>();
  });
  reader.GetAll([&] {
    BentMarker& bent = result.found.bent.emplace_back();
    reader.GetAll([&] {
      BentPiece& piece = bent.pieces.emplace_back();
      get(&piece.p);
      get(&piece.bends);
      get(&piece.by_bends);
    });
    bent.sigma = reader.Get<double>();
  });
  return reader.IsComplete() ? std::optional(result) : std::nullopt;
}

// What the white images of an ordinary camera say.
struct WhiteField {
  cv::Mat attenuation;  // empty: there are no white images
  std::vector<LeftOut> left_out;
};

WhiteField MeasureWhiteField(const DetectOptions& options) {
  if (options.white_images.empty()) return {};
  WhiteImages white = AverageWhiteImages(options.white_images, options.threads);
  CheckEvenField(white.mean);
  return {SmoothAttenuation(white.mean, !options.bayer.empty()), std::move(white.left_out)};
}

// Detectors hold tables that are costly to build: one a thread, lent to one image at a time.
class DetectorPool {
 public:
  explicit DetectorPool(const Target& target) : target_(target) {}

  MarkerDetections Detect(const cv::Mat& gray) {
    std::unique_ptr<MarkerDetector> detector = Take();
    MarkerDetections found = detector->Detect(gray);
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(detector));
    return found;
  }

 private:
  std::unique_ptr<MarkerDetector> Take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        auto detector = std::move(idle_.back());
        idle_.pop_back();
        return detector;
      }
    }
    return MakeMarkerDetector(target_);
  }

  const Target& target_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<MarkerDetector>> idle_;
};

/// The image as an evenly bright camera would see it; darkened as a whole where its range would not
/// do.
cv::Mat Devignetted(const cv::Mat& gray, const cv::Mat& attenuation) {
  cv::Mat exact, even;
  gray.convertTo(exact, CV_32F);
  exact /= attenuation;
  double highest = 0;
  cv::minMaxLoc(exact, nullptr, &highest);
  exact.convertTo(even, CV_8U, std::min(1.0, 255 / std::max(highest, 1.0)));
  return even;
}

/// An image without vignetting where that is known.
cv::Mat EvenGray(const std::filesystem::path& path, const cv::Mat& attenuation) {
  const cv::Mat gray = ReadGray(path);
  return gray.size() == attenuation.size() ? Devignetted(gray, attenuation) : gray;
}

/// All images of a camera together know its lens better than each alone.
void MeasureByCommonLens(const ImageSize& size, std::vector<ImageResult>* results) {
  std::vector<LensReading> readings;
  for (const ImageResult& result : *results) {
    if (result.size != size) continue;
    const std::vector<LensReading>& of_image = result.found.readings;
    readings.insert(readings.end(), of_image.begin(), of_image.end());
  }
  const LensCurvature lens(readings);
  for (ImageResult& result : *results) {
    for (size_t i = 0; i < result.found.bent.size(); ++i) {
      const Eigen::Vector2d moved = lens.Change(result.found.bent[i]);
      Observation& marker = result.found.markers[i];
      marker.values[0] += moved.x();
      marker.values[1] += moved.y();
      marker.sigma = lens.Sigma(result.found.bent[i]);
    }
  }
}

}  // namespace

std::string internal::WhiteKey(const DetectOptions& options) {
  std::string key = options.bayer.empty() ? "plain" : "mosaic";
  for (const FrameImage& image : options.white_images) key += "\n" + HashFile(image.path);
  return key;
}

ImageDetections DetectImages(const std::vector<FrameImage>& images,
                             const Target& target,
                             const DetectOptions& options) {
  if (options.plenoptic) return DetectPlenopticImages(images, target, options);
  // Images run in parallel; threads inside OpenCV would only compete with them.
  cv::setNumThreads(1);
  WhiteField white = MeasureWhiteField(options);
  const cv::Mat& attenuation = white.attenuation;
  StageStore none({}, {}, true);
  StageStore& store = options.store != nullptr ? *options.store : none;
  const std::string white_key = internal::WhiteKey(options);
  std::vector<ImageResult> results(images.size());
  DetectorPool detectors(target);
  std::atomic<size_t> done{0};
  std::atomic<bool> stop{false};
  std::mutex progress_mutex;
  ParallelFor(images.size(), options.threads, [&](size_t i) {
    if (stop) return;
    ImageResult& result = results[i];
    std::string picture;
    try {
      const std::string key = store.Key({"markers", white_key, HashFile(images[i].path)});
      if (const auto kept = store.Load(key)) {
        if (const auto known = Unpack(*kept)) result = *known;
      }
      if (!result.reused || options.keep) {
        const cv::Mat gray = EvenGray(images[i].path, attenuation);
        result.size = {gray.cols, gray.rows};
        if (!result.reused) {
          result.found = detectors.Detect(gray);
          store.Save(key, Pack(result));
        }
        if (options.keep) {
          picture = EncodeImage(".png", internal::MarkerPicture(gray, result.found.markers));
        }
      }
    } catch (const Error& error) {
      result.unreadable = error.what();
    }
    if (!picture.empty()) options.keep(images[i].frame + ".png", picture);
    const size_t count = ++done;
    if (options.progress) {
      const std::lock_guard lock(progress_mutex);
      if (!options.progress(count)) stop = true;
    }
  });
  if (stop) throw Stopped();

  // The size of most images is the camera's; with as many of one as of another, the first seen.
  std::map<ImageSize, int> sizes;
  for (const ImageResult& result : results) {
    if (result.unreadable.empty()) ++sizes[result.size];
  }
  if (sizes.empty()) {
    throw Error(ErrorKind::kJob,
                fmt::format("no image can be read; the first: {}", results[0].unreadable));
  }
  ImageDetections detections;
  detections.left_out = std::move(white.left_out);
  int most = 0;
  for (const ImageResult& result : results) {
    if (result.unreadable.empty() && sizes[result.size] > most) {
      most = sizes[result.size];
      detections.image_size = result.size;
    }
  }

  const ImageSize white_size{attenuation.cols, attenuation.rows};
  if (!attenuation.empty() && white_size != detections.image_size) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("the white images are {} x {} pixels, but the images {} x {}; record them "
                    "with the same settings of the camera",
                    white_size[0],
                    white_size[1],
                    detections.image_size[0],
                    detections.image_size[1]));
  }

  if (!attenuation.empty()) detections.vignetting = EncodeImage(".tiff", attenuation);

  MeasureByCommonLens(detections.image_size, &results);

  const FrameImage* fullest = nullptr;
  size_t most_markers = 0, fullest_view = 0;
  for (size_t i = 0; i < images.size(); ++i) {
    ImageResult& result = results[i];
    if (result.reused) ++detections.reused;
    const std::string path = images[i].path.string();
    if (!result.unreadable.empty()) {
      detections.left_out.push_back({path, WithoutPath(result.unreadable, path)});
    } else if (result.size != detections.image_size) {
      detections.left_out.push_back(
          {path,
           fmt::format("is {} x {} pixels, while the camera's images are {} x {}",
                       result.size[0],
                       result.size[1],
                       detections.image_size[0],
                       detections.image_size[1])});
    } else {
      for (const std::string& reason : result.found.left_out) {
        detections.left_out.push_back({path, reason});
      }
      if (result.found.markers.empty()) {
        detections.left_out.push_back({path, result.found.failure});
      } else {
        if (result.found.markers.size() > most_markers) {
          most_markers = result.found.markers.size();
          fullest = &images[i];
          fullest_view = detections.views.size();
        }
        detections.views.push_back({images[i].frame, std::move(result.found.markers)});
      }
    }
  }
  if (fullest != nullptr) {
    const cv::Mat gray = EvenGray(fullest->path, attenuation);
    const View& view = detections.views[fullest_view];
    detections.sample = {view.frame, internal::SamplePicture(gray, view.observations), {}};
  }
  return detections;
}

}  // namespace plenocal
