// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_codecs.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>

#include "calib/base/error.h"
#include "detectors/images/image_header.h"

namespace plenocal {
namespace {

// Two functions of opencv2/imgcodecs.hpp. They are looked up by their symbols, since a linked call
// would load the library at the start of the program.
using Decode = cv::Mat(cv::InputArray content, int flags);
constexpr const char* kDecodeSymbol = "_ZN2cv8imdecodeERKNS_11_InputArrayEi";
using Encode = bool(const std::string& format,
                    cv::InputArray image,
                    std::vector<std::uint8_t>& content,
                    const std::vector<int>& parameters);
constexpr const char* kEncodeSymbol =
    "_ZN2cv8imencodeERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKNS_11_InputArrayERSt6vectorIhSaIhEERKSB_IiSaIiEE";

struct Codecs {
  Decode* decode;
  Encode* encode;
};

void* FindSymbol(void* library, const char* symbol) {
  void* const found = dlsym(library, symbol);
  if (found != nullptr) return found;
  throw Error(
      ErrorKind::kJob,
      fmt::format(
          "{} has no {}: it is not the OpenCV that plenocal was built with; build plenocal again",
          PLENOCAL_IMGCODECS,
          symbol));
}

Codecs LoadCodecs() {
  // Read while the library is loaded. It is the limit for formats whose headers are not read here.
  setenv("OPENCV_IO_MAX_IMAGE_PIXELS", std::to_string(kMostPixels).c_str(), 1);
  void* const library = dlopen(PLENOCAL_IMGCODECS, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    throw Error(
        ErrorKind::kJob,
        fmt::format(
            "cannot load {}, which reads and writes images ({}); install OpenCV's imgcodecs",
            PLENOCAL_IMGCODECS,
            dlerror()));
  }
  return {reinterpret_cast<Decode*>(FindSymbol(library, kDecodeSymbol)),
          reinterpret_cast<Encode*>(FindSymbol(library, kEncodeSymbol))};
}

const Codecs& LoadedCodecs() {
  static const Codecs kCodecs = LoadCodecs();
  return kCodecs;
}

// Closes standard error to the codecs while an object of this class lives: libpng, libtiff and
// OpenCV write there about files that they are given, without a way to ask them not to. The file
// number is the process's, so the first object of several threads turns it away and the last one
// brings it back.
class SilentCodecs {
 public:
  SilentCodecs() {
    const std::lock_guard lock(mutex);
    if (users++ > 0) return;
    std::fflush(stderr);
    standard_error = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
    const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (standard_error >= 0 && nowhere >= 0) dup2(nowhere, STDERR_FILENO);
    if (nowhere >= 0) close(nowhere);
  }
  ~SilentCodecs() {
    const std::lock_guard lock(mutex);
    if (--users > 0 || standard_error < 0) return;
    std::fflush(stderr);
    dup2(standard_error, STDERR_FILENO);
    close(standard_error);
  }
  SilentCodecs(const SilentCodecs&) = delete;
  SilentCodecs& operator=(const SilentCodecs&) = delete;

 private:
  static inline std::mutex mutex;
  static inline int users = 0, standard_error = -1;
};

}  // namespace

cv::Mat DecodeImage(const std::vector<std::uint8_t>& content, int flags) {
  // Debian's OpenCV gives DICOM files to GDCM, which ends the program at a damaged one.
  constexpr std::string_view kDicom = "DICM";
  constexpr std::size_t kAt = 128;
  if (content.size() >= kAt + kDicom.size() &&
      std::equal(kDicom.begin(), kDicom.end(), content.begin() + kAt)) {
    return {};
  }
  const Codecs& codecs = LoadedCodecs();
  const SilentCodecs silent;
  try {
    return codecs.decode(content, flags);
  } catch (const cv::Exception& error) {
    if (error.code == cv::Error::StsNoMem) throw;
    return {};
  }
}

std::string EncodeImage(const std::string& format,
                        const cv::Mat& image,
                        const std::vector<int>& parameters) {
  std::vector<std::uint8_t> content;
  const Codecs& codecs = LoadedCodecs();
  const SilentCodecs silent;
  if (!codecs.encode(format, image, content, parameters)) {
    throw Error(ErrorKind::kJob, fmt::format("OpenCV cannot write {} images", format));
  }
  return {content.begin(), content.end()};
}

}  // namespace plenocal
