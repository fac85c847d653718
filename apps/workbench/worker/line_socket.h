// SPDX-License-Identifier: Apache-2.0
//
// Sends JSON in lines over a socket, between the workbench and its worker.
#pragma once

#include <chrono>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace plenocal::workbench {

/// One end; closes it. One thread receives, any may send.
class LineSocket {
 public:
  explicit LineSocket(int file) : file_(file) {}
  ~LineSocket();
  LineSocket(const LineSocket&) = delete;
  LineSocket& operator=(const LineSocket&) = delete;

  /// Nothing happens where nobody reads: `Receive` finds that out.
  void Send(const nlohmann::json& message);
  /// The next message; null after `patience` (negative: none is too long) without one, and nothing
  /// when the other end is closed.
  std::optional<nlohmann::json> Receive(std::chrono::milliseconds patience);

 private:
  int file_;
  std::mutex sending_;
  std::string read_;  // beyond the last message
};

}  // namespace plenocal::workbench
