// SPDX-License-Identifier: Apache-2.0
#include "detectors/detect_plenoptic.h"

#include <fmt/format.h>

#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <utility>

#include "calib/error.h"
#include "calib/stage_record.h"
#include "detectors/depth_picture.h"
#include "detectors/depth_shift.h"
#include "detectors/focus.h"
#include "detectors/focused_markers.h"
#include "detectors/image.h"
#include "detectors/marker_looks.h"
#include "detectors/marker_picture.h"
#include "detectors/micro_image_markers.h"
#include "detectors/sample_picture.h"
#include "detectors/vignetting_shift.h"
#include "detectors/white_camera.h"

namespace plenocal {
namespace {

struct RawDetections {
  internal::MicroView markers;
  std::vector<std::string> left_out;
  std::string failure;
};

std::string Pack(const RawDetections& found) {
  StageWriter writer;
  writer.PutAll(found.markers, [&](const internal::MicroObservation& o) {
    writer.Put(o.seen);
    writer.Put(o.inverse_depth);
    for (const double change : o.pull.reshaped()) writer.Put(change);
    for (const double change : o.by_depth) writer.Put(change);
    writer.Put(o.type);
  });
  writer.PutAll(found.left_out, [&](const std::string& reason) { writer.Put(reason); });
  writer.Put(found.failure);
  return writer.Text();
}

std::optional<RawDetections> UnpackDetections(const std::string& text) {
  StageReader reader(text);
  RawDetections found;
  reader.GetAll([&] {
    internal::MicroObservation& o = found.markers.emplace_back();
    o.seen = reader.Get<Observation>();
    o.inverse_depth = reader.Get<double>();
    for (double& change : o.pull.reshaped()) change = reader.Get<double>();
    for (double& change : o.by_depth) change = reader.Get<double>();
    o.type = reader.Get<int>();
  });
  reader.GetAll([&] { found.left_out.push_back(reader.Get<std::string>()); });
  found.failure = reader.Get<std::string>();
  return reader.IsComplete() ? std::optional(found) : std::nullopt;
}

/// Pictures for a person's eye: what their names end in and the files' content.
using Pictures = std::vector<std::pair<std::string, std::string>>;

std::string Pack(const Pictures& pictures) {
  StageWriter writer;
  writer.PutAll(pictures, [&](const auto& picture) {
    writer.Put(picture.first);
    writer.Put(picture.second);
  });
  return writer.Text();
}

std::optional<Pictures> UnpackPictures(const std::string& text) {
  StageReader reader(text);
  Pictures pictures;
  reader.GetAll([&] {
    auto name = reader.Get<std::string>();
    pictures.emplace_back(std::move(name), reader.Get<std::string>());
  });
  return reader.IsComplete() ? std::optional(pictures) : std::nullopt;
}

/// What the white images of a plenoptic camera say.
struct WhiteField {
  MicroLensArray array;
  std::string attenuation_tiff, grid_png;
  std::vector<LeftOut> left_out;
};

std::string Pack(const WhiteField& white) {
  StageWriter writer;
  for (const int length : white.array.image_size) writer.Put(length);
  writer.Put(white.array.types);
  for (const Eigen::Vector2d& e : {white.array.e_column, white.array.e_row}) {
    writer.Put(e.x());
    writer.Put(e.y());
  }
  writer.PutAll(white.array.lenses, [&](const MicroLens& lens) {
    writer.Put(lens.row);
    writer.Put(lens.column);
    writer.Put(lens.centre.x());
    writer.Put(lens.centre.y());
    writer.Put(lens.type);
    writer.Put(lens.usable);
  });
  writer.Put(white.attenuation_tiff);
  writer.Put(white.grid_png);
  writer.PutAll(white.left_out, [&](const LeftOut& item) {
    writer.Put(item.where);
    writer.Put(item.reason);
  });
  return writer.Text();
}

std::optional<WhiteField> UnpackWhiteField(const std::string& text) {
  StageReader reader(text);
  WhiteField white;
  for (int& length : white.array.image_size) length = reader.Get<int>();
  white.array.types = reader.Get<int>();
  for (Eigen::Vector2d* e : {&white.array.e_column, &white.array.e_row}) {
    e->x() = reader.Get<double>();
    e->y() = reader.Get<double>();
  }
  reader.GetAll([&] {
    MicroLens& lens = white.array.lenses.emplace_back();
    lens.row = reader.Get<int>();
    lens.column = reader.Get<int>();
    lens.centre.x() = reader.Get<double>();
    lens.centre.y() = reader.Get<double>();
    lens.type = reader.Get<int>();
    lens.usable = reader.Get<bool>();
  });
  white.attenuation_tiff = reader.Get<std::string>();
  white.grid_png = reader.Get<std::string>();
  reader.GetAll([&] {
    auto where = reader.Get<std::string>();
    white.left_out.push_back({std::move(where), reader.Get<std::string>()});
  });
  return reader.IsComplete() ? std::optional(white) : std::nullopt;
}

WhiteField MeasureWhiteField(const DetectOptions& options, StageStore* store) {
  const std::string key = store->Key({"micro lenses", internal::WhiteKey(options)});
  if (const auto kept = store->Load(key)) {
    if (auto known = UnpackWhiteField(*kept)) return std::move(*known);
  }
  WhiteCamera camera = MeasureWhiteImages(options.white_images,
                                          {.plenoptic = true,
                                           .bayer = !options.bayer.empty(),
                                           .grid_file = std::nullopt,
                                           .raw_image = {},
                                           .threads = options.threads});
  WhiteField white{camera.grid->array,
                   std::move(camera.attenuation_tiff),
                   std::move(camera.grid_png),
                   std::move(camera.left_out)};
  store->Save(key, Pack(white));
  return white;
}

std::string Pack(const SampleView& sample) {
  StageWriter writer;
  writer.Put(sample.picture);
  writer.Put(sample.depth);
  return writer.Text();
}

std::optional<SampleView> UnpackSample(const std::string& frame, const std::string& text) {
  StageReader reader(text);
  SampleView sample{.frame = frame, .picture = reader.Get<std::string>(), .depth = {}};
  sample.depth = reader.Get<std::string>();
  return reader.IsComplete() ? std::optional(sample) : std::nullopt;
}

size_t CountMarkers(const internal::MicroView& view) {
  std::set<int> markers;
  for (const internal::MicroObservation& o : view) markers.insert(o.seen.marker);
  return markers.size();
}

/// The markers of one raw image, measured in its micro images; with a sample's pictures, and those
/// of all stages when asked for.
RawDetections DetectInRaw(const cv::Mat& raw,
                          const Target& target,
                          const internal::FocusedMarkers& markers,
                          const PlenopticCamera& camera,
                          int threads,
                          SampleView* sample,
                          Pictures* pictures) {
  FocusOptions focus{.threads = threads, .find_flat_parts = {}};
  focus.find_flat_parts = [&](const cv::Mat& image) { return markers.FlatParts(image); };
  const FocusedView view = Focus(raw, camera, focus);
  const MarkerDetections found = markers.Detect(view.image);
  cv::Mat grey;
  view.image.convertTo(grey, CV_8U, internal::ScaleTo8Bits(view.image));
  sample->picture = internal::SamplePicture(grey, found.markers);
  sample->depth = internal::SampleDepthPicture(view.depth);
  if (pictures != nullptr) {
    *pictures = {
        {"_focused.png", EncodeImage(".png", grey)},
        {"_markers.png", EncodeImage(".png", internal::MarkerPicture(grey, found.markers))},
        {"_virtual_depth.png", EncodeImage(".png", internal::DepthPicture(view.depth))}};
  }
  std::vector<internal::MarkerLook> looks = internal::LooksOf(target, found.markers);
  // From pixels of the focused image to raw pixels.
  const double scale = view.depth.scale;
  for (internal::MarkerLook& look : looks) {
    look.place *= scale;
    look.cells_by_image.leftCols<2>() /= scale;
  }
  // Those of the focused view have been changed by its own estimate of the shifts near their edges.
  const internal::LensPatches patches = GreyPatches(raw, camera, threads);
  RawDetections result{.markers = internal::MeasureInMicroImages(
                           looks, view.depth, patches, camera.array, view.noise, threads),
                       .left_out = found.left_out,
                       .failure = found.failure};
  if (result.markers.empty() && result.failure.empty()) {
    result.failure = "the target is in the focused image, but no micro image shows a marker well";
  }
  return result;
}

}  // namespace

ImageDetections DetectPlenopticImages(const std::vector<FrameImage>& images,
                                      const Target& target,
                                      const DetectOptions& options) {
  if (options.white_images.empty()) {
    throw Error(ErrorKind::kInput,
                "a plenoptic camera needs white_images: the micro-image centres come from them");
  }
  StageStore none({}, {}, true);
  StageStore& store = options.store != nullptr ? *options.store : none;
  WhiteField white = MeasureWhiteField(options, &store);
  const std::string& tiff = white.attenuation_tiff;
  const PlenopticCamera camera{
      std::move(white.array),
      cv::imdecode(std::vector<std::uint8_t>(tiff.begin(), tiff.end()), cv::IMREAD_UNCHANGED),
      options.bayer};
  ImageDetections detections;
  detections.image_size = camera.array.image_size;
  detections.left_out = std::move(white.left_out);
  detections.micro_lenses = FormatMicroLenses(camera.array);
  detections.vignetting = std::move(white.attenuation_tiff);
  if (options.keep) options.keep("micro_lenses.png", white.grid_png);
  const std::string white_key = internal::WhiteKey(options);

  const internal::FocusedMarkers markers(target);
  std::vector<std::string> frames;
  std::vector<internal::MicroView> views;
  // The image with most markers; its sample is empty when an earlier run detected it.
  size_t fullest = 0, most_markers = 0;
  SampleView sample;
  const auto detect = [&](const FrameImage& image, SampleView* made, Pictures* pictures) {
    made->frame = image.frame;
    return DetectInRaw(
        ReadImage(image.path), target, markers, camera, options.threads, made, pictures);
  };
  for (size_t i = 0; i < images.size(); ++i) {
    const std::string path = images[i].path.string();
    std::optional<Pictures> pictures;
    SampleView made;
    try {
      const std::string image_key = HashFile(images[i].path);
      const std::string key = store.Key({"micro images", white_key, image_key});
      const std::string pictures_key = store.Key({"pictures", white_key, image_key});
      std::optional<RawDetections> known;
      if (const auto kept = store.Load(key)) known = UnpackDetections(*kept);
      if (options.keep) {
        if (const auto kept = store.Load(pictures_key)) pictures = UnpackPictures(*kept);
      }
      if (known && (pictures || !options.keep)) {
        ++detections.reused;
      } else {
        if (options.keep) pictures.emplace();
        known = detect(images[i], &made, options.keep ? &*pictures : nullptr);
        if (options.keep) store.Save(pictures_key, Pack(*pictures));
        store.Save(key, Pack(*known));
      }
      RawDetections& found = *known;
      for (const std::string& reason : found.left_out)
        detections.left_out.push_back({path, reason});
      if (found.markers.empty()) {
        detections.left_out.push_back({path, found.failure});
      } else {
        if (const size_t count = CountMarkers(found.markers); count > most_markers) {
          most_markers = count;
          fullest = i;
          sample = std::move(made);
        }
        frames.push_back(images[i].frame);
        views.push_back(std::move(found.markers));
      }
    } catch (const Error& error) {
      detections.left_out.push_back({path, WithoutPath(error.what(), path)});
    }
    if (pictures) {
      for (const auto& [ending, content] : *pictures) {
        options.keep(images[i].frame + ending, content);
      }
    }
    if (options.progress && !options.progress(i + 1)) throw Stopped();
  }
  if (most_markers > 0) {
    const FrameImage& image = images[fullest];
    const std::string key = store.Key({"sample", white_key, HashFile(image.path)});
    if (sample.frame.empty()) {
      if (const auto kept = store.Load(key)) {
        if (auto known = UnpackSample(image.frame, *kept)) sample = std::move(*known);
      }
    }
    // An interrupted run keeps none.
    if (sample.frame.empty()) detect(image, &sample, nullptr);
    store.Save(key, Pack(sample));
    detections.sample = std::move(sample);
  }
  auto uncertain = internal::RemoveVignettingShifts(camera.array.types, &views);
  internal::RemoveDepthShifts(&views);
  for (size_t i = 0; i < views.size(); ++i) {
    View view{frames[i], {}};
    for (const internal::MicroObservation& o : views[i]) {
      view.observations.push_back(o.seen);
      view.observations.back().kind = o.type;
    }
    view.shared_errors = std::move(uncertain[i]);
    detections.views.push_back(std::move(view));
  }
  return detections;
}

}  // namespace plenocal
