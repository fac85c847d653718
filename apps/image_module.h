// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "apps/evaluate/bar_chart.h"
#include "apps/evaluate/field_map.h"
#include "apps/print/print_target.h"
#include "apps/report/attenuation_map.h"
#include "apps/simulate/simulate.h"
#include "apps/undistort/resample_images.h"
#include "apps/undistort/virtual_view_images.h"
#include "calib/session.h"
#include "detectors/detect_images.h"
#include "detectors/focus_images.h"
#include "detectors/white_camera.h"
#include "targets/target.h"

/// What the image module exports: `DetectImages` of detectors/detect_images.h.
extern "C" void plenocal_detect_images(const std::vector<plenocal::FrameImage>& images,
                                       const plenocal::Target& target,
                                       const plenocal::DetectOptions& options,
                                       plenocal::ImageDetections* detections);

/// What the image module exports: `MeasureWhiteImages` of detectors/white_camera.h.
extern "C" void plenocal_measure_white_images(const std::vector<plenocal::FrameImage>& images,
                                              const plenocal::WhiteOptions& options,
                                              plenocal::WhiteCamera* camera);

/// What the image module exports: `FocusImages` of detectors/focus_images.h.
extern "C" void plenocal_focus_images(const plenocal::FocusRequest& request);

/// What the image module exports: `PrintTarget` of apps/print/print_target.h.
extern "C" void plenocal_print_target(const plenocal::PrintCommand& command,
                                      std::vector<std::filesystem::path>* written);

/// What the image module exports: `Simulate` of apps/simulate/simulate.h.
extern "C" void plenocal_simulate(const plenocal::SimulateCommand& command,
                                  const plenocal::SimulateOptions& options,
                                  std::string* summary);

/// What the image module exports: `DrawBarChart` of apps/evaluate/bar_chart.h.
extern "C" void plenocal_draw_bar_chart(const plenocal::BarChart& chart,
                                        plenocal::PictureFormat format,
                                        std::string* content);

/// What the image module exports: `DrawFieldMaps` of apps/evaluate/field_map.h.
extern "C" void plenocal_draw_field_maps(const std::vector<plenocal::FieldMap>& maps,
                                         double largest,
                                         std::string* content);

/// What the image module exports: `ReadAttenuationMap` of apps/report/attenuation_map.h.
extern "C" void plenocal_read_attenuation_map(const std::string& tiff,
                                              const std::string& name,
                                              int longer,
                                              plenocal::AttenuationMap* map);

/// What the image module exports: `ResampleImages` of apps/undistort/resample_images.h.
extern "C" void plenocal_resample_images(const plenocal::ResampleRequest& request, size_t* count);

/// What the image module exports: `MakeVirtualViews` of apps/undistort/virtual_view_images.h.
extern "C" void plenocal_make_virtual_views(const plenocal::VirtualViewRequest& request,
                                            size_t* count);

/// What the image module exports: `VignettePng` of apps/undistort/resample_images.h.
extern "C" void plenocal_vignette_png(const std::filesystem::path& attenuation, std::string* png);

/// What the image module exports: `MapFiles` of apps/undistort/resample_images.h.
extern "C" void plenocal_map_files(const plenocal::PixelMap& map,
                                   const std::vector<double>& pinhole,
                                   const std::string& format,
                                   std::map<std::string, std::string>* files);

namespace plenocal {

/// Tells this build of the image module from others: the hash of its file.
std::string ImageModuleHash();

/// `DetectImages` by the image module, which is loaded on first use. Throws `Error` of kind kJob
/// when the installation lacks it.
ImageDetections DetectImagesByModule(const std::vector<FrameImage>& images,
                                     const Target& target,
                                     const DetectOptions& options);

/// `MeasureWhiteImages` by the image module.
WhiteCamera MeasureWhiteImagesByModule(const std::vector<FrameImage>& images,
                                       const WhiteOptions& options);

/// `FocusImages` by the image module.
void FocusImagesByModule(const FocusRequest& request);

/// `PrintTarget` by the image module.
std::vector<std::filesystem::path> PrintTargetByModule(const PrintCommand& command);

/// `Simulate` by the image module.
std::string SimulateByModule(const SimulateCommand& command, const SimulateOptions& options);

/// `DrawBarChart` by the image module.
std::string DrawBarChartByModule(const BarChart& chart, PictureFormat format);

/// `DrawFieldMaps` by the image module.
std::string DrawFieldMapsByModule(const std::vector<FieldMap>& maps, double largest);

/// `ReadAttenuationMap` by the image module.
AttenuationMap ReadAttenuationMapByModule(const std::string& tiff,
                                          const std::string& name,
                                          int longer);

/// `ResampleImages` by the image module.
size_t ResampleImagesByModule(const ResampleRequest& request);

/// `MakeVirtualViews` by the image module.
size_t MakeVirtualViewsByModule(const VirtualViewRequest& request);

/// `VignettePng` by the image module.
std::string VignettePngByModule(const std::filesystem::path& attenuation);

/// `MapFiles` by the image module.
std::map<std::string, std::string> MapFilesByModule(const PixelMap& map,
                                                    const std::vector<double>& pinhole,
                                                    const std::string& format);

}  // namespace plenocal
