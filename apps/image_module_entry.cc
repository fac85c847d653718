// SPDX-License-Identifier: Apache-2.0
#include "apps/image_module.h"

extern "C" void plenocal_detect_images(const std::vector<plenocal::FrameImage>& images,
                                       const plenocal::Target& target,
                                       const plenocal::DetectOptions& options,
                                       plenocal::ImageDetections* detections) {
  *detections = plenocal::DetectImages(images, target, options);
}

extern "C" void plenocal_measure_white_images(const std::vector<plenocal::FrameImage>& images,
                                              const plenocal::WhiteOptions& options,
                                              plenocal::WhiteCamera* camera) {
  *camera = plenocal::MeasureWhiteImages(images, options);
}

extern "C" void plenocal_focus_images(const plenocal::FocusRequest& request) {
  plenocal::FocusImages(request);
}

extern "C" void plenocal_simulate(const plenocal::SimulateCommand& command,
                                  const plenocal::SimulateOptions& options,
                                  std::string* summary) {
  *summary = plenocal::Simulate(command, options);
}

extern "C" void plenocal_print_target(const plenocal::PrintCommand& command,
                                      std::vector<std::filesystem::path>* written) {
  *written = plenocal::PrintTarget(command);
}

extern "C" void plenocal_draw_bar_chart(const plenocal::BarChart& chart,
                                        plenocal::PictureFormat format,
                                        std::string* content) {
  *content = plenocal::DrawBarChart(chart, format);
}

extern "C" void plenocal_draw_field_maps(const std::vector<plenocal::FieldMap>& maps,
                                         double largest,
                                         std::string* content) {
  *content = plenocal::DrawFieldMaps(maps, largest);
}

extern "C" void plenocal_read_attenuation_map(const std::string& tiff,
                                              const std::string& name,
                                              int longer,
                                              plenocal::AttenuationMap* map) {
  *map = plenocal::ReadAttenuationMap(tiff, name, longer);
}

extern "C" void plenocal_resample_images(const plenocal::ResampleRequest& request, size_t* count) {
  *count = plenocal::ResampleImages(request);
}

extern "C" void plenocal_map_files(const plenocal::PixelMap& map,
                                   const std::vector<double>& pinhole,
                                   const std::string& format,
                                   std::map<std::string, std::string>* files) {
  *files = plenocal::MapFiles(map, pinhole, format);
}

extern "C" void plenocal_make_virtual_views(const plenocal::VirtualViewRequest& request,
                                            size_t* count) {
  *count = plenocal::MakeVirtualViews(request);
}

extern "C" void plenocal_vignette_png(const std::filesystem::path& attenuation, std::string* png) {
  *png = plenocal::VignettePng(attenuation);
}
