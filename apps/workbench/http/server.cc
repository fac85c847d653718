// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/http/server.h"

#include <fmt/format.h>

#include <atomic>
#include <boost/asio.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <exception>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"

namespace plenocal::workbench {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::use_awaitable;
using tcp = asio::ip::tcp;
using Parser = http::request_parser<http::string_body>;
using Response = http::response<http::string_body>;

constexpr size_t kMostHeader = 16 * 1024, kMostBody = 1024 * 1024;
constexpr size_t kMostUpload = size_t{256} * 1024 * 1024;
constexpr int kMostConnections = 64, kThreads = 6;
constexpr auto kRequestTime = std::chrono::seconds(10), kIdleTime = std::chrono::seconds(30);
constexpr auto kEventPause = std::chrono::milliseconds(100);
constexpr auto kAlive = std::chrono::seconds(10);

// Without the body.
Request ToRequest(const http::request<http::string_body>& message, Address target) {
  Request request{.method = std::string(message.method_string()),
                  .path = std::move(target.path),
                  .query = std::move(target.query),
                  .headers = {},
                  .body = {}};
  for (const auto& field : message) {
    request.headers[LowerCase(std::string(field.name_string()))] = std::string(field.value());
  }
  return request;
}

Response ToResponse(const Answer& answer, unsigned version, bool keep_alive) {
  Response response{static_cast<http::status>(answer.status), version};
  for (const auto& [name, value] : SafetyHeaders()) response.set(name, value);
  for (const auto& [name, value] : answer.headers) response.set(name, value);
  response.set(http::field::content_type, answer.type);
  response.keep_alive(keep_alive);
  response.body() = answer.body;
  response.prepare_payload();
  return response;
}

}  // namespace

struct Server::State {
  explicit State(ServerOptions given) : options(std::move(given)), acceptor(context) {}

  // Only who has the token may send more than a session's text.
  size_t MostBody(const http::request<http::string_body>& header) const {
    const auto target = header.target();
    std::optional<Address> parsed = ParseAddress({target.data(), target.size()});
    if (!parsed) return kMostBody;
    const Request request = ToRequest(header, std::move(*parsed));
    const bool allowed = !Refuse(request, header.count(http::field::host), options.token);
    return allowed && IsUpload(request) ? kMostUpload : kMostBody;
  }

  // Takes the message's body.
  Answer AnswerTo(http::request<http::string_body>& message) const {
    const auto target = message.target();
    std::optional<Address> parsed = ParseAddress({target.data(), target.size()});
    if (!parsed) return ErrorAnswer(400, "this is no address of the workbench");
    Request request = ToRequest(message, std::move(*parsed));
    request.body = std::move(message.body());
    if (auto refused = Refuse(request, message.count(http::field::host), options.token)) {
      return *refused;
    }
    try {
      return options.handler(request);
    } catch (const Error& error) {
      return ErrorAnswer(400, error.what());
    } catch (const std::exception& error) {
      return ErrorAnswer(500, fmt::format("internal error: {}", error.what()));
    }
  }

  static bool IsEventStream(const http::request<http::string_body>& message) {
    const auto target = message.target();
    return message.method() == http::verb::get &&
           (target == "/api/events" || target.starts_with("/api/events?"));
  }

  // Written as long as the page listens; a comment line now and then finds out that it has left.
  asio::awaitable<void> StreamEvents(beast::tcp_stream& stream,
                                     const http::request<http::string_body>& message) {
    size_t seen = options.events->Last();
    const auto last = message.find("Last-Event-ID");
    if (last != message.end()) {
      seen = std::strtoul(std::string(last->value()).c_str(), nullptr, 10);
    }
    std::string text =
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nConnection: close\r\n";
    for (const auto& [name, value] : SafetyHeaders())
      text += fmt::format("{}: {}\r\n", name, value);
    text += fmt::format("\r\nid: {}\nevent: open\ndata: {{}}\n\n", seen);
    asio::steady_timer timer(co_await asio::this_coro::executor);
    auto written = std::chrono::steady_clock::now();
    while (!stopped) {
      const auto now = std::chrono::steady_clock::now();
      if (text.empty() && now - written > kAlive) text = ": alive\n\n";
      if (!text.empty()) {
        stream.expires_after(kRequestTime);
        co_await asio::async_write(stream, asio::buffer(text), use_awaitable);
        written = now;
      }
      timer.expires_after(kEventPause);
      co_await timer.async_wait(use_awaitable);
      text = options.events->After(&seen);
    }
  }

  asio::awaitable<void> Serve(tcp::socket socket) {
    beast::tcp_stream stream(std::move(socket));
    beast::flat_buffer buffer(kMostHeader + kMostBody);
    try {
      for (bool keep_alive = true; keep_alive && !stopped;) {
        Parser parser;
        parser.header_limit(kMostHeader);
        parser.body_limit(kMostUpload);
        stream.expires_after(kIdleTime);
        co_await http::async_read_header(stream, buffer, parser, use_awaitable);
        const size_t most = MostBody(parser.get());
        parser.body_limit(most);
        if (parser.content_length().value_or(0) > most) {
          throw boost::system::system_error(http::error::body_limit);
        }
        stream.expires_after(kRequestTime);
        co_await http::async_read(stream, buffer, parser, use_awaitable);
        auto message = parser.release();
        const Answer answer = AnswerTo(message);
        if (answer.status == 200 && IsEventStream(message)) {
          co_await StreamEvents(stream, message);
          break;
        }
        keep_alive = message.keep_alive();
        const Response response = ToResponse(answer, message.version(), keep_alive);
        stream.expires_after(kIdleTime);
        co_await http::async_write(stream, response, use_awaitable);
      }
    } catch (const boost::system::system_error& error) {
      Close(stream, error.code());
    }
    boost::system::error_code ignored;
    stream.socket().shutdown(tcp::socket::shutdown_both, ignored);
    --connections;
  }

  // What the parser refuses is answered where that is possible.
  static void Close(beast::tcp_stream& stream, const boost::system::error_code& error) {
    const bool too_large = error == http::error::header_limit || error == http::error::body_limit ||
                           error == http::error::buffer_overflow;
    if (!too_large &&
        error.category() != http::make_error_code(http::error::bad_method).category()) {
      return;
    }
    if (error == http::error::end_of_stream || error == http::error::partial_message) return;
    const Answer answer = ErrorAnswer(too_large ? 413 : 400, "this request is refused");
    const Response response = ToResponse(answer, 11, false);
    boost::system::error_code ignored;
    stream.socket().non_blocking(true, ignored);
    http::serializer<false, http::string_body> serializer(response);
    http::write(stream.socket(), serializer, ignored);
  }

  asio::awaitable<void> Accept() {
    for (;;) {
      boost::system::error_code error;
      tcp::socket socket =
          co_await acceptor.async_accept(asio::redirect_error(use_awaitable, error));
      if (!acceptor.is_open()) co_return;
      if (error) continue;
      if (connections >= kMostConnections) continue;  // closes it
      ++connections;
      asio::co_spawn(asio::make_strand(context), Serve(std::move(socket)), asio::detached);
    }
  }

  ServerOptions options;
  asio::io_context context;
  tcp::acceptor acceptor;
  std::atomic<int> connections{0};
  std::atomic<bool> stopped{false};
};

Server::Server(ServerOptions options) : state_(std::make_unique<State>(std::move(options))) {
  const tcp::endpoint endpoint(asio::ip::address_v4::loopback(), state_->options.port);
  try {
    state_->acceptor.open(endpoint.protocol());
    state_->acceptor.set_option(asio::socket_base::reuse_address(true));
    state_->acceptor.bind(endpoint);
    state_->acceptor.listen();
  } catch (const boost::system::system_error& error) {
    throw JobError("cannot listen on 127.0.0.1:{}: {}; choose another --port",
                   state_->options.port,
                   error.code().message());
  }
}

Server::~Server() = default;

unsigned short Server::Port() const { return state_->acceptor.local_endpoint().port(); }

void Server::Run(const std::function<bool()>& go_on) {
  asio::co_spawn(state_->context, state_->Accept(), asio::detached);
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([this] {
      // A connection that ends in an exception of its own must not end the server.
      while (!state_->stopped) {
        try {
          state_->context.run();
          break;
        } catch (const std::exception&) {
          continue;
        }
      }
    });
  }
  constexpr auto kPause = std::chrono::milliseconds(100);
  while (go_on()) std::this_thread::sleep_for(kPause);
  state_->stopped = true;
  state_->context.stop();
  for (std::thread& thread : threads) thread.join();
}

}  // namespace plenocal::workbench
