// SPDX-License-Identifier: Apache-2.0
//
// The server on a socket, with requests that no browser sends.
#include "apps/workbench/http/server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <thread>

namespace plenocal::workbench {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class ServerOnASocket : public ::testing::Test {
 protected:
  ServerOnASocket()
      : server_({.port = 0,
                 .token = "secret",
                 .handler =
                     [](const Request& request) {
                       if (request.path.size() > 1 && request.path[1] == "throws") {
                         throw std::runtime_error("a bug");
                       }
                       return Answer{.body = "{\"length\":" + std::to_string(request.body.size()) +
                                             "}"};
                     },
                 .events = &events_}),
        thread_([this] { server_.Run([this] { return !stop_; }); }) {}
  ~ServerOnASocket() override {
    stop_ = true;
    thread_.join();
  }

  [[nodiscard]] int Connect(const char* address = "127.0.0.1") const {
    const int file = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(server_.Port());
    inet_pton(AF_INET, address, &to.sin_addr);
    const timeval patience{5, 0};
    setsockopt(file, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    if (connect(file, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0) return file;
    close(file);
    return -1;
  }

  // What the server sends until it closes, or until `end` is in it.
  [[nodiscard]] std::string Send(const std::string& request, const std::string& end = {}) const {
    const int file = Connect();
    (void)!send(file, request.data(), request.size(), MSG_NOSIGNAL);
    std::string answer;
    char buffer[4096];
    for (ssize_t count = 1; count > 0 && (end.empty() || answer.find(end) == std::string::npos);) {
      count = recv(file, buffer, sizeof buffer, 0);
      if (count > 0) answer.append(buffer, static_cast<size_t>(count));
    }
    close(file);
    return answer;
  }
  [[nodiscard]] std::string Get(const std::string& path, const std::string& headers) const {
    return Send("GET " + path + " HTTP/1.1\r\nConnection: close\r\n" + headers + "\r\n");
  }

  static constexpr const char* kGood = "Host: 127.0.0.1\r\nAuthorization: Bearer secret\r\n";

  void ExpectAlive() const { EXPECT_THAT(Get("/api/state", kGood), StartsWith("HTTP/1.1 200")); }

  EventLog events_;
  std::atomic<bool> stop_{false};
  Server server_;
  std::thread thread_;
};

TEST_F(ServerOnASocket, AnswersThePageAndNobodyElse) {
  ExpectAlive();
  EXPECT_THAT(Get("/api/state", "Host: 127.0.0.1\r\n"), StartsWith("HTTP/1.1 401"));
  EXPECT_THAT(Get("/", "Host: evil.test\r\n"), StartsWith("HTTP/1.1 403"));
  EXPECT_THAT(Get("/", ""), StartsWith("HTTP/1.1 403"));
  EXPECT_THAT(Get("/", "Host: 127.0.0.1\r\nHost: 127.0.0.1\r\n"), StartsWith("HTTP/1.1 40"));
  const std::string answer = Get("/api/events", "Host: 127.0.0.1\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 401"));
  EXPECT_THAT(answer, Not(HasSubstr("Set-Cookie")));
  EXPECT_THAT(answer, HasSubstr("Content-Security-Policy: default-src 'none'"));
}

TEST_F(ServerOnASocket, ListensOnThisMachineAlone) {
  // Another address of the loopback network stands for another interface.
  EXPECT_LT(Connect("127.0.0.2"), 0);
}

TEST_F(ServerOnASocket, SurvivesWhatNoBrowserSends) {
  const std::string good = kGood;
  for (
      const std::string& request :
      {std::string("\r\n\r\n"),
       std::string("GET\r\n\r\n"),
       std::string("\x16\x03\x01\x02\x00\x01", 6),
       "GET / HTTP/1.1\r\nHost: " + std::string(64 * 1024, 'a') + "\r\n\r\n",
       "GET /" + std::string(64 * 1024, 'a') + " HTTP/1.1\r\n" + good + "\r\n",
       "GET /../../etc/passwd HTTP/1.1\r\nConnection: close\r\n" + good + "\r\n",
       "POST /api/x HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 99999999999\r\n" +
           good + "\r\n",
       "POST /api/x HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: -1\r\n" + good +
           "\r\n",
       "POST /api/x HTTP/1.1\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked\r\n" +
           good + "\r\n-5\r\nhello\r\n0\r\n\r\n",
       "POST /api/x HTTP/1.1\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked\r\n" +
           good + "\r\nFFFFFFFF\r\n" + std::string(2 * 1024 * 1024, 'x')}) {
    const std::string answer = Send(request);
    EXPECT_THAT(answer, Not(HasSubstr(" 200 "))) << request.substr(0, 60);
    ExpectAlive();
  }
  EXPECT_THAT(Get("/api/throws", kGood), StartsWith("HTTP/1.1 500"));
  ExpectAlive();
}

TEST_F(ServerOnASocket, TakesLongBodiesOfUploadsWithTheTokenAlone) {
  const auto post = [&](const std::string& path, const std::string& token, size_t size) {
    return Send(
        "POST " + path +
        " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nAuthorization: Bearer " + token +
        "\r\nContent-Type: application/octet-stream\r\nContent-Length: " + std::to_string(size) +
        "\r\n\r\n" + std::string(std::min<size_t>(size, 3'000'000), 'x'));
  };
  EXPECT_THAT(post("/api/files", "secret", 3'000'000), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(post("/api/files", "wrong", 3'000'000), Not(HasSubstr(" 200 ")));
  EXPECT_THAT(post("/api/session", "secret", 3'000'000), Not(HasSubstr(" 200 ")));
  EXPECT_THAT(post("/api/files", "secret", 300'000'000), Not(HasSubstr(" 200 ")));
  ExpectAlive();
}

TEST_F(ServerOnASocket, HoldsManyConnectionsOff) {
  std::vector<int> files;
  for (int i = 0; i < 200; ++i) files.push_back(Connect());
  for (const int file : files) {
    if (file >= 0) close(file);
  }
  // The server learns that they are gone at its next read.
  std::string answer;
  for (int i = 0; i < 50 && !answer.starts_with("HTTP/1.1 200"); ++i) {
    answer = Get("/api/state", kGood);
    if (answer.empty()) usleep(100'000);
  }
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
}

TEST_F(ServerOnASocket, StreamsEventsFromTheOneThatThePageHasSeen) {
  events_.Add("job", "{\"id\":1}");
  events_.Add("job", "{\"id\":2}");
  const std::string answer =
      Send("GET /api/events HTTP/1.1\r\nLast-Event-ID: 1\r\n" + std::string(kGood) + "\r\n",
           "\"id\":2}");
  EXPECT_THAT(answer, HasSubstr("Content-Type: text/event-stream"));
  EXPECT_THAT(answer, HasSubstr("id: 2\nevent: job\ndata: {\"id\":2}"));
  EXPECT_THAT(answer, Not(HasSubstr("\"id\":1}")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
