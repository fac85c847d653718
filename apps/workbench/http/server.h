// SPDX-License-Identifier: Apache-2.0
//
// Serves HTTP on this machine. Boost.Beast stands in the source alone.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "apps/workbench/http/event_log.h"
#include "apps/workbench/http/guard.h"

namespace plenocal::workbench {

struct ServerOptions {
  unsigned short port = 0;  ///< 0: a free one
  std::string token;
  /// Answers what `Refuse` lets pass. May throw `Error`, which becomes an answer of status 400.
  std::function<Answer(const Request&)> handler;
  const EventLog* events = nullptr;  ///< GET /api/events
};

/// Listens on 127.0.0.1 alone. Limits: 16 kB of header, 1 MB of body, 64 connections, 10 s for a
/// request, 30 s without one.
class Server {
 public:
  /// Throws `Error` of kind kJob when the port is taken.
  explicit Server(ServerOptions options);
  ~Server();

  [[nodiscard]] unsigned short Port() const;
  /// Serves until `go_on`, which is asked several times a second, returns false.
  void Run(const std::function<bool()>& go_on);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace plenocal::workbench
