// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/http/guard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "apps/workbench/http/event_log.h"

namespace plenocal::workbench {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr const char* kToken = "0123456789abcdef";

Request ApiRequest(std::map<std::string, std::string> more = {}) {
  Request request{
      .method = "GET",
      .path = {"api", "state"},
      .query = {},
      .headers = {{"host", "127.0.0.1:4711"}, {"authorization", std::string("Bearer ") + kToken}},
      .body = {}};
  for (const auto& [name, value] : more) request.headers[name] = value;
  return request;
}

int StatusOf(const Request& request, size_t hosts = 1) {
  const auto refused = Refuse(request, hosts, kToken);
  return refused ? refused->status : 200;
}

TEST(Guard, LetsThePageIn) {
  EXPECT_EQ(StatusOf(ApiRequest()), 200);
  EXPECT_EQ(StatusOf(ApiRequest({{"host", "localhost:80"}})), 200);
  EXPECT_EQ(StatusOf(ApiRequest({{"host", "[::1]:4711"}})), 200);
  EXPECT_EQ(StatusOf(ApiRequest({{"host", "localhost"}})), 200);
  EXPECT_EQ(StatusOf(ApiRequest(
                {{"origin", "http://127.0.0.1:4711"}, {"sec-fetch-site", "same-origin"}})),
            200);
}

TEST(Guard, RefusesNamesThatAreNotThisMachine) {
  for (const char* host : {"evil.test",
                           "127.0.0.1.evil.test",
                           "localhost.",
                           "LOCALHOST.evil",
                           "",
                           "127.0.0.1:",
                           "127.0.0.1:80:80",
                           "127.0.0.1:8o",
                           "127.0.0.1:123456",
                           "[::1",
                           "[::1]evil",
                           "0.0.0.0",
                           "127.0.0.2",
                           "localhost@evil.test",
                           "127.0.0.1%00"}) {
    EXPECT_EQ(StatusOf(ApiRequest({{"host", host}})), 403) << host;
    // The page's own files are refused as well.
    Request page = ApiRequest({{"host", host}});
    page.path = {};
    EXPECT_EQ(StatusOf(page), 403) << host;
  }
  EXPECT_EQ(StatusOf(ApiRequest(), 0), 403);
  EXPECT_EQ(StatusOf(ApiRequest(), 2), 403);
}

TEST(Guard, RefusesOtherOrigins) {
  for (const char* origin : {"http://evil.test",
                             "null",
                             "http://127.0.0.1:4712",
                             "https://127.0.0.1:4711",
                             "http://localhost:4711"}) {
    EXPECT_EQ(StatusOf(ApiRequest({{"origin", origin}})), 403) << origin;
  }
  for (const char* site : {"cross-site", "same-site"}) {
    EXPECT_EQ(StatusOf(ApiRequest({{"sec-fetch-site", site}})), 403) << site;
  }
}

TEST(Guard, RefusesRequestsWithoutTheToken) {
  for (const char* authorization : {"",
                                    "Bearer",
                                    "Bearer ",
                                    "Bearer 0123456789abcdeF",
                                    "Basic x",
                                    "0123456789abcdef",
                                    "Bearer 0123456789abcdef0",
                                    "Bearer 0123456789abcde"}) {
    EXPECT_EQ(StatusOf(ApiRequest({{"authorization", authorization}})), 401) << authorization;
  }
}

TEST(Guard, TakesBodiesOfJsonAlone) {
  // Forms of other pages can send these without asking.
  for (const char* type :
       {"", "text/plain", "application/x-www-form-urlencoded", "multipart/form-data"}) {
    Request request = ApiRequest({{"content-type", type}});
    request.body = "{}";
    EXPECT_EQ(StatusOf(request), 415) << type;
  }
  Request json = ApiRequest({{"content-type", "application/json"}});
  json.body = "{}";
  EXPECT_EQ(StatusOf(json), 200);
}

TEST(Guard, TakesBytesAsUploadsAlone) {
  Request request = ApiRequest({{"content-type", "application/octet-stream"}});
  request.body = "picture";
  EXPECT_EQ(StatusOf(request), 415);
  request.method = "POST";
  request.path = {"api", "files"};
  EXPECT_EQ(StatusOf(request), 200);
  request.path = {"api", "look"};
  EXPECT_EQ(StatusOf(request), 200);
  request.headers["content-type"] = "multipart/form-data";
  EXPECT_EQ(StatusOf(request), 415);
  request.headers["content-type"] = "application/octet-stream";
  request.headers.erase("authorization");
  EXPECT_EQ(StatusOf(request), 401);
}

TEST(Guard, MakesTokensThatNobodyGuesses) {
  EXPECT_EQ(MakeToken().size(), 64u);
  EXPECT_NE(MakeToken(), MakeToken());
}

TEST(Guard, SendsNoScriptOfOthers) {
  const auto headers = SafetyHeaders();
  EXPECT_THAT(headers.at("Content-Security-Policy"), StartsWith("default-src 'none'"));
  EXPECT_THAT(headers.at("Content-Security-Policy"), HasSubstr("frame-ancestors 'none'"));
  EXPECT_EQ(headers.at("X-Content-Type-Options"), "nosniff");
  EXPECT_EQ(headers.at("Cross-Origin-Resource-Policy"), "same-origin");
}

TEST(Address, IsDecodedByParts) {
  const auto address = ParseAddress("/api/image/left/a%20b?w=240&x=%3F");
  ASSERT_TRUE(address);
  EXPECT_THAT(address->path, ElementsAre("api", "image", "left", "a b"));
  EXPECT_EQ(address->query.at("w"), "240");
  EXPECT_EQ(address->query.at("x"), "?");
  EXPECT_TRUE(ParseAddress("/")->path.empty());
}

TEST(Address, LeadsNowhereElse) {
  for (const char* target : {"",
                             "api",
                             "http://evil/",
                             "/..",
                             "/api/../..",
                             "/api/%2e%2e/x",
                             "/a/..%2fb",
                             "/a%5cb",
                             "/a%5c..%5cb",
                             "/a%00b",
                             "/a%0d%0ab",
                             "/%",
                             "/%g0",
                             "/%2",
                             "/a/.",
                             "/x?a=%00",
                             "/x?a=%zz"}) {
    EXPECT_FALSE(ParseAddress(target)) << target;
  }
  EXPECT_FALSE(ParseAddress("/" + std::string(5000, 'a')));
}

TEST(ErrorAnswers, AreJsonWhateverTheNames) {
  const Answer answer = ErrorAnswer(400, "<script>\"\xff");
  EXPECT_EQ(nlohmann::json::parse(answer.body)["error"]["what"], "<script>\"\\xff");
}

TEST(EventLog, GivesWhatCameAfterAnEvent) {
  EventLog log;
  log.Add("job", "{}");
  log.Add("session", "{\"a\":1}");
  size_t seen = 1;
  EXPECT_EQ(log.After(&seen), "id: 2\nevent: session\ndata: {\"a\":1}\n\n");
  EXPECT_EQ(seen, 2u);
  EXPECT_EQ(log.After(&seen), "");
}

TEST(EventLog, SaysSoWhenEventsAreLost) {
  EventLog log;
  for (size_t i = 0; i <= EventLog::kKept; ++i) log.Add("job", "{}");
  size_t seen = 0, ahead = 99'999;
  EXPECT_THAT(log.After(&seen), HasSubstr("event: reset"));
  EXPECT_EQ(seen, EventLog::kKept + 1);
  // Of a server that was started anew.
  EXPECT_THAT(log.After(&ahead), HasSubstr("event: reset"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
