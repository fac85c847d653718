// SPDX-License-Identifier: Apache-2.0
//
// Exchanges JSON messages, one a line, over the socket between the workbench and its worker.
#pragma once

#include <chrono>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace plenocal::workbench {

/// One end of a socket, which the destructor closes. One thread receives, any thread may send.
class LineSocket {
 public:
  explicit LineSocket(int file) : file_(file) {}
  ~LineSocket();
  LineSocket(const LineSocket&) = delete;
  LineSocket& operator=(const LineSocket&) = delete;

  /// Has no effect if the other end is closed, which `Receive` reports.
  void Send(const nlohmann::json& message);
  /// The next message; null if none comes within `patience` (negative: no limit), nothing if the
  /// other end is closed.
  std::optional<nlohmann::json> Receive(std::chrono::milliseconds patience);

 private:
  int file_;
  std::mutex sending_;
  std::string read_;  // bytes after the last message
};

}  // namespace plenocal::workbench
