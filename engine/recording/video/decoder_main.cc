// SPDX-License-Identifier: Apache-2.0
//
// Program plenocal-video FILE: decodes the frames of a video that `VideoStore` requests through the
// socket at standard input. It is a program of its own because OpenCV's videoio loads 220 shared
// libraries (0.1 s) and sets options of FFmpeg for the whole process.
#include <unistd.h>

#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "engine/recording/video/video_messages.h"

namespace plenocal {
namespace {

constexpr double kMillisecond = 1e-3;

class Decoder {
 public:
  VideoAnswer Open(const char* file) {
    if (!video_.open(file, cv::CAP_FFMPEG)) return {};
    // A camera's pixels as they were recorded.
    video_.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
    return {.good = true,
            .width = static_cast<int>(video_.get(cv::CAP_PROP_FRAME_WIDTH)),
            .height = static_cast<int>(video_.get(cv::CAP_PROP_FRAME_HEIGHT)),
            .frames = video_.get(cv::CAP_PROP_FRAME_COUNT)};
  }

  VideoAnswer Answer(const VideoQuestion& question) {
    frame_.release();
    try {
      switch (question.request) {
        case VideoRequest::kGrab:
          if (!video_.grab()) return {};
          return {.good = true, .time = video_.get(cv::CAP_PROP_POS_MSEC) * kMillisecond};
        case VideoRequest::kRetrieve:
          if (!video_.retrieve(frame_) || frame_.type() != CV_8UC3) frame_.release();
          if (!frame_.isContinuous()) frame_ = frame_.clone();
          return {.good = !frame_.empty(), .width = frame_.cols, .height = frame_.rows};
        case VideoRequest::kSeek:
          return {.good = video_.set(cv::CAP_PROP_POS_FRAMES, question.index)};
      }
    } catch (const cv::Exception&) {
      frame_.release();
    }
    return {};
  }

  /// Pixels of the latest answer.
  [[nodiscard]] const cv::Mat& Frame() const { return frame_; }

 private:
  cv::VideoCapture video_;
  cv::Mat frame_;
};

}  // namespace
}  // namespace plenocal

int main(int argc, char** argv) {
  using namespace plenocal;
  if (argc != 2) {
    std::fputs("plenocal-video decodes videos for plenocal, which runs it\n", stderr);
    return 2;
  }
  Decoder decoder;
  VideoAnswer answer = decoder.Open(argv[1]);
  VideoQuestion question;
  while (SendAll(STDIN_FILENO, &answer, sizeof answer)) {
    const cv::Mat& frame = decoder.Frame();
    if (!frame.empty() && !SendAll(STDIN_FILENO, frame.data, frame.total() * frame.elemSize())) {
      break;
    }
    if (!ReceiveAll(STDIN_FILENO, &question, sizeof question)) break;
    answer = decoder.Answer(question);
  }
  return 0;
}
