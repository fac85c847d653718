// SPDX-License-Identifier: Apache-2.0
#include "engine/exchange/result_bundle.h"

#include <map>
#include <utility>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "calib/io/yaml.h"
#include "engine/recording/stores/zip_archive.h"
#include "engine/session/image_session.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

// Paths of the files below `folder`, relative to it; nothing that a link leads to, nothing hidden.
std::vector<fs::path> VisibleFiles(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  fs::recursive_directory_iterator entry(folder, error);
  for (; !error && entry != fs::end(entry); entry.increment(error)) {
    const bool hidden = entry->path().filename().string().starts_with('.');
    if (hidden) entry.disable_recursion_pending();
    if (hidden || entry->is_symlink() || !entry->is_regular_file()) continue;
    files.push_back(entry->path().lexically_relative(folder));
  }
  if (error) throw InputError("{}: no folder that can be read", folder.string());
  return files;
}

}  // namespace

std::string ResultBundle(const fs::path& folder, bool pictures) {
  CompleteResults(folder);
  std::map<std::string, std::string> files;
  for (const fs::path& file : VisibleFiles(folder)) {
    const fs::path type = file.extension();
    const bool is_text = !file.has_parent_path() && (type == ".yaml" || type == ".csv");
    if (!is_text && (!pictures || type == ".zip")) continue;
    files[file.string()] = ReadEarlierResult(folder / file);
  }
  if (files.empty()) {
    throw InputError(
        "{}: has no results; give the folder that 'plenocal calibrate' or 'detect' wrote",
        folder.string());
  }
  if (files.contains("calibration.yaml") && !files.contains(ImageSession::kSessionName)) {
    const auto run = YamlNode::ReadFile(folder / "calibration.yaml").Find("provenance");
    for (const auto& [key, name] : {std::pair{"session_text", ImageSession::kSessionName},
                                    {"target_text", ImageSession::kTargetName}}) {
      const auto text = run ? run->Find(key) : std::nullopt;
      if (text) files.try_emplace(name, text->AsString());
    }
  }
  return ZipBytes({files.begin(), files.end()});
}

}  // namespace plenocal
