// SPDX-License-Identifier: Apache-2.0
//
// Values of keys that name images, in sessions and recordings. All throw `Error` with file, line
// and key.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// The path in `node`, relative to the folder of the YAML file `file`.
std::string PathBeside(const std::filesystem::path& file, const YamlNode& node);

/// One path or a list of them: globs, folders, files.
std::vector<std::string> PathsBeside(const std::filesystem::path& file, const YamlNode& node);

/// The images of a camera: `images`, of a recording with its `topic` behind it.
std::vector<std::string> ReadImagePatterns(const std::filesystem::path& file,
                                           const YamlNode& camera);

/// The colours of a raw mosaic, one of `kBayerOrders`.
BayerOrder ReadBayerOrder(const YamlNode& node);

}  // namespace plenocal
