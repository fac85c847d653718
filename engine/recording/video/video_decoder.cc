// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/video/video_decoder.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string>
#include <string_view>

#include "calib/base/format_error.h"
#include "calib/io/own_file.h"

extern char** environ;

namespace plenocal {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void RefuseStart(std::string_view reason) {
  throw JobError(
      "cannot start plenocal-video, which reads videos ({}); install OpenCV's videoio (Debian: "
      "libopencv-videoio406), or extract the frames: ffmpeg -i VIDEO frames/%06d.png",
      reason);
}

/// The program in the folder of this one or above: bin/ or lib/ beside libexec/, as installed and
/// as built.
fs::path DecoderProgram() {
  constexpr int kAbove = 4;  // lib/python3/dist-packages/plenocal
  fs::path folder = fs::canonical(OwnFile()).parent_path();
  for (int i = 0; i <= kAbove; ++i, folder = folder.parent_path()) {
    fs::path program = folder / PLENOCAL_VIDEO_DECODER;
    if (fs::exists(program)) return program;
  }
  RefuseStart("it is not installed");
}

}  // namespace

VideoDecoder::VideoDecoder(const fs::path& video) {
  const std::string program = DecoderProgram().string(), file = video.string();
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    RefuseStart(std::strerror(errno));
  }
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
  // Libraries report damage to standard error, frame by frame; the store's notes have it once.
  for (const int output : {STDOUT_FILENO, STDERR_FILENO}) {
    posix_spawn_file_actions_addopen(&actions, output, "/dev/null", O_WRONLY, 0);
  }
  // A group of its own: Ctrl-C ends this process, which ends the decoder.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  std::array<char*, 3> arguments{
      const_cast<char*>(program.c_str()), const_cast<char*>(file.c_str()), nullptr};
  const int error =
      posix_spawn(&process_, program.c_str(), &actions, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  socket_ = ends[0];
  if (error != 0) {
    close(socket_);
    RefuseStart(std::strerror(error));
  }
  if (ReceiveAll(socket_, &opened_, sizeof opened_)) return;
  opened_ = {};
  constexpr int kNotLoaded = 127;  // exit status of the dynamic linker
  const int status = End();
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNotLoaded) {
    RefuseStart("its libraries cannot be loaded");
  }
}

VideoDecoder::~VideoDecoder() { End(); }

int VideoDecoder::End() {
  if (socket_ < 0) return 0;
  close(socket_);
  socket_ = -1;
  int status = 0;
  while (waitpid(process_, &status, 0) < 0) {
    if (errno != EINTR) return 0;
  }
  return status;
}

VideoAnswer VideoDecoder::Ask(VideoRequest request, std::size_t index) {
  const VideoQuestion question{request, static_cast<int>(index)};
  VideoAnswer answer;
  const bool done =
      SendAll(socket_, &question, sizeof question) && ReceiveAll(socket_, &answer, sizeof answer);
  return done ? answer : VideoAnswer{};
}

bool VideoDecoder::Receive(std::span<std::uint8_t> pixels) {
  return ReceiveAll(socket_, pixels.data(), pixels.size());
}

}  // namespace plenocal
