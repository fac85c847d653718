// SPDX-License-Identifier: Apache-2.0
//
// Files that hold many images: recordings of ROS, MCAP, videos.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal {

/// An image as it is stored.
struct StoredImage {
  std::vector<std::uint8_t> bytes = {};  ///< an image file, or pixels row by row
  /// The storage of pixels, by its name in ROS: mono8, mono16, bgr8, bayer_rggb8, 8UC1, ... Empty:
  /// `bytes` are an image file.
  std::string encoding = {};
  ImageSize size{};         ///< of pixels
  std::size_t step = 0;     ///< bytes from one row of pixels to the next
  bool big_endian = false;  ///< of pixels of 16 bits
};

/// The images of one camera in a file that holds many. Its functions may be called from several
/// threads; images are found fastest in the order of the file.
class ImageStore {
 public:
  ImageStore() = default;
  virtual ~ImageStore() = default;
  ImageStore(const ImageStore&) = delete;
  ImageStore& operator=(const ImageStore&) = delete;

  /// Throws `Error` of kind kInput, naming the file, for one that is damaged.
  [[nodiscard]] virtual StoredImage Read(std::size_t index) const = 0;
  /// `Read` of at least the first `most` bytes, or of all of fewer.
  [[nodiscard]] virtual StoredImage Start(std::size_t index, std::size_t most) const = 0;
  /// False: all images are pixels, none is an image file.
  [[nodiscard]] virtual bool HasFiles() const { return true; }
  /// Differs for images that differ; empty when the image cannot be read.
  [[nodiscard]] virtual std::string Hash(std::size_t index) const = 0;
};

}  // namespace plenocal
