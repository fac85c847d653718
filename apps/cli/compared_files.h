// SPDX-License-Identifier: Apache-2.0
//
// Comparison of two files of results, whatever they hold.
#pragma once

#include <filesystem>
#include <string>

#include "calib/io/output_folder.h"
#include "engine/compare_files.h"

namespace plenocal {

/// A comparison for the terminal and as files.
struct ComparedFiles {
  std::string text;
  OutputContents files;
};

/// Compares two calibrations, attenuations or ground truths. `files`: the files are wanted, too.
/// Throws `Error` of kind kInput for files of two kinds, and as `CompareFiles`.
ComparedFiles CompareFilesOfAnyKind(const std::filesystem::path& first,
                                    const std::filesystem::path& second,
                                    const ComparedBy& by,
                                    bool files);

}  // namespace plenocal
