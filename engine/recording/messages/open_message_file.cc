// SPDX-License-Identifier: Apache-2.0
#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/recording/messages/bag_file.h"
#include "engine/recording/messages/db3_file.h"
#include "engine/recording/messages/mcap_file.h"

namespace plenocal {

std::shared_ptr<const MessageFile> OpenMessageFile(const std::filesystem::path& path) {
  constexpr std::size_t kStart = 16;
  const std::string start = ReadInputStart(path, kStart);
  std::shared_ptr<const MessageFile> file;
  if (start.starts_with(kMcapMagic)) {
    file = std::make_shared<const McapFile>(path);
  } else if (start.starts_with(kBagMagic)) {
    file = std::make_shared<const BagFile>(path);
  } else if (start.starts_with(kDb3Magic)) {
    file = std::make_shared<const Db3File>(path);
  } else if (start.starts_with("#ROSBAG")) {
    throw InputError("{}: is a bag of an old version, '{}'; convert it by 'rosbag migrate'",
                     path.string(),
                     start.substr(0, start.find('\n')));
  } else {
    throw InputError("{}: {}; copy it again",
                     path.string(),
                     start.empty() ? "is empty (0 bytes)"
                                   : "is no MCAP file, bag of ROS 1 or database of ROS 2, "
                                     "or damaged at its beginning");
  }
  if (file->Topics().empty() && !file->Damage().empty()) {
    throw InputError(
        "{}: {}, and holds no message before; copy it again", path.string(), file->Damage()[0]);
  }
  return file;
}

}  // namespace plenocal
