// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/detect_plenoptic.h"

#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "detectors/images/detect_images.h"
#include "detectors/images/image.h"
#include "detectors/images/pictures.h"
#include "detectors/plenoptic/cached_results.h"
#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "detectors/plenoptic/markers/focused_image_detector.h"
#include "detectors/plenoptic/markers/marker_blur.h"
#include "detectors/plenoptic/markers/marker_views.h"
#include "detectors/plenoptic/markers/measure_markers.h"
#include "detectors/plenoptic/views/depth_picture.h"
#include "detectors/plenoptic/white/grid_picture.h"
#include "detectors/plenoptic/white/white_camera.h"
#include "detectors/templates/marker_template.h"

namespace plenocal {
namespace {

using internal::MicroLensCalibration;
using internal::Pictures;
using internal::RawDetections;
using internal::RawMeasurements;

/// From the white images, or from the cache.
MicroLensCalibration MeasureMicroLenses(const DetectOptions& options, DetectionCache* cache) {
  const std::string key = cache->Key({"micro lenses", internal::WhiteKey(options)});
  if (const auto kept = cache->Load(key)) {
    if (auto known = internal::UnpackMicroLenses(*kept)) return std::move(*known);
  }
  cv::Mat attenuation, levelled;
  WhiteCamera camera = internal::MeasureWhite(
      options.white_images,
      {.plenoptic = true, .bayer = options.bayer, .threads = options.threads},
      &attenuation,
      &levelled);
  MicroLensCalibration micro_lenses{
      camera.grid->array,
      std::vector<float>(attenuation.begin<float>(), attenuation.end<float>()),
      EncodeImage(".png", GridPicture(levelled, camera.grid->array)),
      std::move(camera.left_out),
      std::move(camera.warnings)};
  cache->Save(key, PackEntry(micro_lenses));
  return micro_lenses;
}

size_t CountMarkers(const RawMeasurements& image) {
  std::set<int> markers;
  for (const internal::MarkerMeasurement& m : image) markers.insert(m.observation.marker);
  return markers.size();
}

/// Results of one raw image.
struct RawResult {
  RawDetections detections;
  SampleView sample;  ///< without a frame's name when the detections are from the cache
  Pictures pictures;  ///< when they are wanted
  bool is_cached = false;
};

/// Detection in the raw images of one camera.
class RawDetector {
 public:
  RawDetector(const Target& target,
              const PlenopticCamera& camera,
              const DetectOptions& options,
              DetectionCache* cache)
      : camera_(camera),
        options_(options),
        cache_(*cache),
        white_key_(internal::WhiteKey(options)),
        detector_(target) {}

  /// From the cache or, where it has not all that is wanted, from the image.
  RawResult Detect(const FrameImage& image) {
    const std::string image_key = HashImage(image);
    const std::string key = cache_.Key({"micro images", white_key_, image_key});
    const std::string pictures_key = cache_.Key({"pictures", white_key_, image_key});
    const bool wants_pictures = options_.keep != nullptr;
    auto detections = LoadEntry<RawDetections>(cache_, key);
    std::optional<Pictures> pictures;
    if (wants_pictures) pictures = LoadEntry<Pictures>(cache_, pictures_key);
    RawResult result;
    if (detections && (pictures || !wants_pictures)) {
      result.is_cached = true;
      result.detections = std::move(*detections);
      if (pictures) result.pictures = std::move(*pictures);
      return result;
    }
    result = DetectInImage(image);
    if (wants_pictures) cache_.Save(pictures_key, PackEntry(result.pictures));
    cache_.Save(key, PackEntry(result.detections));
    return result;
  }

  /// The sample of an image. `made`: from this run, without a frame's name if it was not detected.
  SampleView Sample(const FrameImage& image, SampleView made) {
    const std::string key = cache_.Key({"sample", white_key_, HashImage(image)});
    if (made.frame.empty()) {
      if (auto known = LoadEntry<SampleView>(cache_, key)) {
        made = std::move(*known);
        made.frame = image.frame;
      }
    }
    // An interrupted run keeps none.
    if (made.frame.empty()) made = DetectInImage(image).sample;
    cache_.Save(key, PackEntry(made));
    return made;
  }

 private:
  RawResult DetectInImage(const FrameImage& image) const {
    const cv::Mat raw = ReadImage(image);
    ReconstructionOptions options{.threads = options_.threads, .find_flat_parts = {}};
    options.find_flat_parts = [&](const cv::Mat& focused) { return detector_.FlatParts(focused); };
    const Reconstruction view = Reconstruct(raw, camera_, options);
    const MarkerDetections found = detector_.Detect(view.image);
    RawResult result;
    MakePictures(view, found, &result);
    result.sample.frame = image.frame;
    result.detections = {.markers = Measure(raw, view, found),
                         .left_out = found.left_out,
                         .failure = found.failure,
                         .lattice = view.lattice};
    if (result.detections.markers.empty() && found.failure.empty()) {
      result.detections.failure =
          "the target is in the focused image, but no micro image shows a marker well";
    }
    return result;
  }

  /// Measures the markers of the focused image in the micro images.
  [[nodiscard]] RawMeasurements Measure(const cv::Mat& raw,
                                        const Reconstruction& view,
                                        const MarkerDetections& found) const {
    std::vector<internal::MarkerTemplate> markers = detector_.Templates(view.image, found.markers);
    // From pixels of the focused image to raw pixels.
    const double scale = view.depth.scale;
    for (internal::MarkerTemplate& marker : markers) {
      marker.position *= scale;
      marker.cells_by_image.leftCols<2>() /= scale;
    }
    // The reconstruction has changed its own patches by its estimate of the displacement near their
    // edges.
    const internal::LensPatches patches = GreyPatches(raw, camera_, options_.threads);
    return internal::MeasureMarkers(
        markers, view.depth, patches, camera_.array, view.noise, options_.threads);
  }

  void MakePictures(const Reconstruction& view,
                    const MarkerDetections& found,
                    RawResult* result) const {
    cv::Mat grey;
    view.image.convertTo(grey, CV_8U, internal::ScaleTo8Bits(view.image));
    result->sample.picture = internal::SamplePicture(grey, found.markers);
    result->sample.depth = internal::SampleDepthPicture(view.depth);
    if (!options_.keep) return;
    result->pictures = {
        {"_focused.png", EncodeImage(".png", grey)},
        {"_markers.png", EncodeImage(".png", internal::MarkerPicture(grey, found.markers))},
        {"_virtual_depth.png", EncodeImage(".png", internal::DepthPicture(view.depth))}};
  }

  const PlenopticCamera& camera_;
  const DetectOptions& options_;
  DetectionCache& cache_;
  std::string white_key_;
  internal::FocusedImageDetector detector_;
};

/// Detects the target in all images; keeps the sample of the image with most markers.
void DetectInImages(const std::vector<FrameImage>& images,
                    const DetectOptions& options,
                    int types,
                    RawDetector* detector,
                    ImageDetections* detections) {
  std::vector<std::string> frames;
  std::vector<RawMeasurements> measured;
  size_t fullest = 0, most_markers = 0;
  SampleView sample;
  for (size_t i = 0; i < images.size(); ++i) {
    const std::string path = images[i].path.string();
    RawResult result;
    ImageReport report{images[i].frame, 0, {}};
    try {
      result = detector->Detect(images[i]);
      if (result.is_cached) ++detections->reused;
      RawDetections& found = result.detections;
      detections->traits[images[i].frame].lattice = found.lattice;
      for (const std::string& reason : found.left_out) {
        detections->left_out.push_back({path, reason});
      }
      if (found.markers.empty()) {
        detections->left_out.push_back({path, found.failure, true});
        report.why = found.failure;
      } else {
        if (const size_t count = CountMarkers(found.markers); count > most_markers) {
          most_markers = count;
          fullest = i;
          sample = std::move(result.sample);
        }
        report.points = CountMarkers(found.markers);
        frames.push_back(images[i].frame);
        measured.push_back(std::move(found.markers));
      }
    } catch (const Error& error) {
      report.why = WithoutPath(error.what(), path);
      detections->left_out.push_back({path, report.why, true});
    }
    for (const auto& [ending, content] : result.pictures) {
      options.keep(images[i].frame + ending, content);
    }
    if (options.report) options.report(report);
    if (options.progress && !options.progress(i + 1)) throw Stopped();
  }
  if (most_markers > 0) detections->sample = detector->Sample(images[fullest], std::move(sample));
  detections->views = MarkerViews(frames, types, measured, options.tilted_array);
  detections->blur = internal::MeasureBlur(measured);
}

}  // namespace

ImageDetections DetectPlenopticImages(const std::vector<FrameImage>& images,
                                      const Target& target,
                                      const DetectOptions& options) {
  if (options.white_images.empty()) {
    throw InputError(
        "a plenoptic camera needs white_images: the micro-image centres come from them");
  }
  DetectionCache none({}, {}, true);
  DetectionCache& cache = options.cache != nullptr ? *options.cache : none;
  MicroLensCalibration micro_lenses = MeasureMicroLenses(options, &cache);
  const auto [width, height] = micro_lenses.array.image_size;
  const PlenopticCamera camera{std::move(micro_lenses.array),
                               cv::Mat(height, width, CV_32F, micro_lenses.attenuation.data()),
                               options.bayer};
  ImageDetections detections;
  detections.image_size = camera.array.image_size;
  detections.left_out = std::move(micro_lenses.left_out);
  detections.warnings = std::move(micro_lenses.warnings);
  detections.micro_lenses = FormatMicroLenses(camera.array);
  detections.lattice_errors = camera.array.errors;
  detections.vignetting = EncodeImage(".tiff", camera.attenuation);
  if (options.keep) options.keep("micro_lenses.png", micro_lenses.grid_png);
  RawDetector detector(target, camera, options, &cache);
  DetectInImages(images, options, camera.array.types, &detector, &detections);
  return detections;
}

}  // namespace plenocal
