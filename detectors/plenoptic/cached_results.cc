// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/cached_results.h"

#include <algorithm>

#include "calib/camera/observation_entry.h"
#include "calib/io/detection_cache.h"

namespace plenocal::internal {

std::string Pack(const MicroLensCalibration& micro_lenses) {
  CacheEntryWriter writer;
  for (const int length : micro_lenses.array.image_size) writer.Put(length);
  writer.Put(micro_lenses.array.types);
  for (const Eigen::Vector2d& e : {micro_lenses.array.e_column, micro_lenses.array.e_row}) {
    writer.Put(e.x());
    writer.Put(e.y());
  }
  writer.PutAll(micro_lenses.array.lenses, [&](const MicroLens& lens) {
    writer.Put(lens.row);
    writer.Put(lens.column);
    writer.Put(lens.centre.x());
    writer.Put(lens.centre.y());
    writer.Put(lens.type);
    writer.Put(lens.usable);
  });
  writer.Put(micro_lenses.attenuation_tiff);
  writer.Put(micro_lenses.grid_png);
  writer.PutAll(micro_lenses.left_out, [&](const LeftOut& item) {
    writer.Put(item.where);
    writer.Put(item.reason);
  });
  return writer.Text();
}

std::optional<MicroLensCalibration> UnpackMicroLenses(const std::string& bytes) {
  CacheEntryReader reader(bytes);
  MicroLensCalibration micro_lenses;
  for (int& length : micro_lenses.array.image_size) length = reader.Get<int>();
  micro_lenses.array.types = reader.Get<int>();
  for (Eigen::Vector2d* e : {&micro_lenses.array.e_column, &micro_lenses.array.e_row}) {
    e->x() = reader.Get<double>();
    e->y() = reader.Get<double>();
  }
  reader.GetAll([&] {
    MicroLens& lens = micro_lenses.array.lenses.emplace_back();
    lens.row = reader.Get<int>();
    lens.column = reader.Get<int>();
    lens.centre.x() = reader.Get<double>();
    lens.centre.y() = reader.Get<double>();
    lens.type = reader.Get<int>();
    lens.usable = reader.Get<bool>();
  });
  micro_lenses.attenuation_tiff = reader.Get<std::string>();
  micro_lenses.grid_png = reader.Get<std::string>();
  reader.GetAll([&] {
    auto where = reader.Get<std::string>();
    micro_lenses.left_out.push_back({std::move(where), reader.Get<std::string>()});
  });
  // The types are indices.
  const MicroLensArray& array = micro_lenses.array;
  const bool good = array.types <= kMostLensTypes &&
                    std::ranges::all_of(array.lenses, [&](const MicroLens& lens) {
                      return lens.type >= 0 && lens.type < array.types;
                    });
  return good && reader.IsComplete() ? std::optional(micro_lenses) : std::nullopt;
}

std::string Pack(const RawDetections& found) {
  CacheEntryWriter writer;
  writer.PutAll(found.markers, [&](const MarkerMeasurement& o) {
    PutObservation(o.observation, &writer);
    writer.Put(o.inverse_depth);
    for (const double change : o.vignetting_sensitivity.reshaped()) writer.Put(change);
    for (const double change : o.depth_sensitivity) writer.Put(change);
    writer.Put(o.lens_type);
    writer.Put(o.blur);
    writer.Put(o.blur_sigma);
  });
  writer.PutAll(found.left_out, [&](const std::string& reason) { writer.Put(reason); });
  writer.Put(found.failure);
  return writer.Text();
}

std::optional<RawDetections> UnpackDetections(const std::string& bytes) {
  CacheEntryReader reader(bytes);
  RawDetections found;
  reader.GetAll([&] {
    MarkerMeasurement& o = found.markers.emplace_back();
    o.observation = GetObservation(&reader);
    o.inverse_depth = reader.Get<double>();
    for (double& change : o.vignetting_sensitivity.reshaped()) change = reader.Get<double>();
    for (double& change : o.depth_sensitivity) change = reader.Get<double>();
    o.lens_type = reader.Get<int>();
    o.blur = reader.Get<double>();
    o.blur_sigma = reader.Get<double>();
  });
  reader.GetAll([&] { found.left_out.push_back(reader.Get<std::string>()); });
  found.failure = reader.Get<std::string>();
  return reader.IsComplete() ? std::optional(found) : std::nullopt;
}

std::string Pack(const Pictures& pictures) {
  CacheEntryWriter writer;
  writer.PutAll(pictures, [&](const auto& picture) {
    writer.Put(picture.first);
    writer.Put(picture.second);
  });
  return writer.Text();
}

std::optional<Pictures> UnpackPictures(const std::string& bytes) {
  CacheEntryReader reader(bytes);
  Pictures pictures;
  reader.GetAll([&] {
    auto name = reader.Get<std::string>();
    pictures.emplace_back(std::move(name), reader.Get<std::string>());
  });
  return reader.IsComplete() ? std::optional(pictures) : std::nullopt;
}

std::string Pack(const SampleView& sample) {
  CacheEntryWriter writer;
  writer.Put(sample.picture);
  writer.Put(sample.depth);
  return writer.Text();
}

std::optional<SampleView> UnpackSample(const std::string& frame, const std::string& bytes) {
  CacheEntryReader reader(bytes);
  SampleView sample{.frame = frame, .picture = reader.Get<std::string>(), .depth = {}};
  sample.depth = reader.Get<std::string>();
  return reader.IsComplete() ? std::optional(sample) : std::nullopt;
}

}  // namespace plenocal::internal
