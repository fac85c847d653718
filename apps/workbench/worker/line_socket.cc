// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/worker/line_socket.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>

#include "calib/base/json_text.h"

namespace plenocal::workbench {

LineSocket::~LineSocket() { close(file_); }

void LineSocket::Send(const nlohmann::json& message) {
  const std::string line = JsonText(message, -1) + "\n";
  const std::lock_guard lock(sending_);
  size_t done = 0;
  while (done < line.size()) {
    const ssize_t count = send(file_, line.data() + done, line.size() - done, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return;
    done += static_cast<size_t>(count);
  }
}

std::optional<nlohmann::json> LineSocket::Receive(std::chrono::milliseconds patience) {
  for (;;) {
    if (const size_t end = read_.find('\n'); end != std::string::npos) {
      const std::string line = read_.substr(0, end);
      read_.erase(0, end + 1);
      return nlohmann::json::parse(line, nullptr, false);
    }
    pollfd ready{file_, POLLIN, 0};
    if (poll(&ready, 1, static_cast<int>(patience.count())) == 0) return nullptr;
    char buffer[65536];
    const ssize_t count = recv(file_, buffer, sizeof buffer, MSG_DONTWAIT);
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count <= 0) return std::nullopt;
    read_.append(buffer, static_cast<size_t>(count));
  }
}

}  // namespace plenocal::workbench
