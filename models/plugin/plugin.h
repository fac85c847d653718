// SPDX-License-Identifier: Apache-2.0
//
// Camera models from outside (docs/new_model.md): a shared library that
// `plenocal --plugin ./libmine.so` and `LoadCameraModels` (models/registry.h) take.
#pragma once

#include <ceres/version.h>

#include <Eigen/Core>
#include <array>
#include <span>

#include "calib/camera/camera_model.h"
#include "models/plugin/interface.h"

#define PLENOCAL_TEXT_OF(x) #x
#define PLENOCAL_TEXT(x) PLENOCAL_TEXT_OF(x)
#ifdef _GLIBCXX_DEBUG
#define PLENOCAL_PLUGIN_CONTAINERS ", debug containers"
#else
#define PLENOCAL_PLUGIN_CONTAINERS ""
#endif

/// All on which the layout of what crosses the border between program and plug-in depends; where
/// it differs, neither can read the other's data.
#define PLENOCAL_PLUGIN_ABI                                                                                           \
  PLENOCAL_PLUGIN_INTERFACE                                                                                           \
  ", Eigen " PLENOCAL_TEXT(EIGEN_WORLD_VERSION) "." PLENOCAL_TEXT(EIGEN_MAJOR_VERSION) "." PLENOCAL_TEXT(             \
      EIGEN_MINOR_VERSION) " aligned to " PLENOCAL_TEXT(EIGEN_MAX_STATIC_ALIGN_BYTES) ", Ceres " CERES_VERSION_STRING \
                                                                                      ", string ABI " PLENOCAL_TEXT(  \
                                                                                          _GLIBCXX_USE_CXX11_ABI)     \
                                                                                          PLENOCAL_PLUGIN_CONTAINERS

/// Symbols that a plug-in exports: data only, so that nothing of it runs before the ABI is known.
extern "C" {
extern const char plenocal_plugin_abi[] __attribute__((visibility("default")));
extern const std::span<const plenocal::CameraModel> plenocal_plugin_models
    __attribute__((visibility("default")));
}

namespace plenocal::internal {

template <CameraModelPlugin... Models>
constexpr std::array<CameraModel, sizeof...(Models)> TableOf() {
  return {MakeCameraModel<Models>()...};
}

}  // namespace plenocal::internal

/// Makes the shared library that is compiled from this file a plug-in with these models, structs as
/// in models/. Stands once, outside of all namespaces.
#define PLENOCAL_CAMERA_MODEL_PLUGIN(...)                                              \
  namespace {                                                                          \
  constexpr auto plenocal_plugin_table = ::plenocal::internal::TableOf<__VA_ARGS__>(); \
  }                                                                                    \
  constinit const char plenocal_plugin_abi[] = PLENOCAL_PLUGIN_ABI;                    \
  constinit const std::span<const ::plenocal::CameraModel> plenocal_plugin_models(     \
      plenocal_plugin_table);
