// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/api.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "calib/base/error.h"
#include "tests/apps/recording/small_images.h"
#include "tests/temporary_folder.h"

namespace plenocal::workbench {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

constexpr const char* kSession =
    "plenocal: 1  # <script>alert(1)</script>\n"
    "target: target.yaml\n"
    "cameras:\n"
    "  left: {model: pinhole-radtan, images: left/*.png}\n";

class ApiOfAFolder : public testing::InTemporaryFolder {
 protected:
  ApiOfAFolder() {
    Write("root/session.yaml", kSession);
    Write("root/target.yaml",
          "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 0.025\n");
    Write("root/left/<img src=x onerror=alert(1)>.png", "no image");
    Write("root/left/b.png", "no image either");
    Write("outside/secret.png", "secret");
    fs::create_directory_symlink(folder_ / "outside", folder_ / "root/link");
    fs::create_symlink(folder_ / "outside/secret.png", folder_ / "root/left/c.png");
    project_.emplace(folder_ / "root");
    jobs_.emplace("no program", project_->Root(), &events_);
    api_.emplace(&*project_, &*jobs_, &events_);
  }

  [[nodiscard]] std::string Session() const { return files_.Read("root/session.yaml"); }

  // The answer, or one of status 400 with the message as the server makes it.
  Answer Ask(const std::string& method,
             std::vector<std::string> path,
             const std::string& body = {},
             std::map<std::string, std::string> query = {}) {
    path.insert(path.begin(), "api");
    try {
      return api_->Handle({.method = method,
                           .path = std::move(path),
                           .query = std::move(query),
                           .headers = {},
                           .body = body});
    } catch (const Error& error) {
      return ErrorAnswer(400, error.what());
    }
  }

  EventLog events_;
  std::optional<Project> project_;
  std::optional<Jobs> jobs_;
  std::optional<Api> api_;
};

TEST_F(ApiOfAFolder, ListsNothingBeyondIt) {
  const Json here = Json::parse(Ask("GET", {"files"}).body);
  EXPECT_EQ(here["entries"].size(), 1u) << "the link is not listed";
  for (const char* dir : {"..", "../outside", "link", "left/../..", "/etc"}) {
    const Answer answer = Ask("GET", {"files"}, {}, {{"dir", dir}});
    EXPECT_EQ(answer.status, 400) << dir;
    EXPECT_THAT(answer.body, Not(HasSubstr("entries"))) << dir;
  }
}

TEST_F(ApiOfAFolder, ShowsImagesOfTheSessionAlone) {
  EXPECT_THAT(Ask("GET", {"image", "left", "c"}).body, Not(HasSubstr("secret")));
  EXPECT_EQ(Ask("GET", {"image", "left", "c"}).status, 400);
  EXPECT_EQ(Ask("GET", {"image", "left", "b"}).status, 400);
  EXPECT_EQ(Ask("GET", {"image", "right", "b"}).status, 404);
  EXPECT_EQ(Ask("GET", {"image", "left", "secret"}).status, 404);
  EXPECT_EQ(Ask("GET", {"image", "left", "b"}, {}, {{"w", "-3"}}).status, 400);
}

TEST_F(ApiOfAFolder, FocusesImagesOfTheSessionAlone) {
  const auto focus = [&](const char* camera, const char* frame) {
    return Ask("POST",
               {"jobs"},
               Json{{"kind", "focus"}, {"run", 0}, {"camera", camera}, {"frame", frame}}.dump());
  };
  EXPECT_THAT(focus("left", "secret").body, HasSubstr("no image secret of left"));
  EXPECT_THAT(focus("../left", "b").body, HasSubstr("is no name"));
  EXPECT_THAT(focus("left", "-o").body, HasSubstr("is no name"));
  EXPECT_THAT(focus("left", "b").body, HasSubstr("micro_lenses_left.csv"));
  fs::create_symlink(folder_ / "outside/secret.png", folder_ / "root/micro_lenses_left.csv");
  EXPECT_EQ(focus("left", "b").status, 400) << "a link leads out";
  EXPECT_TRUE(jobs_->All().empty());
}

TEST_F(ApiOfAFolder, ShowsNoFilesAsSheetsOfTheTarget) {
  fs::create_directories(folder_ / "root/.plenocal/drawing");
  fs::create_directory_symlink(folder_ / "outside", folder_ / "root/.plenocal/drawing/link");
  for (const char* part : {"link", "..", "nothing"}) {
    const Answer answer = Ask("GET", {"drawing", part, "secret.png"});
    EXPECT_EQ(answer.status, 400) << part;
    EXPECT_THAT(answer.body, Not(HasSubstr("secret\n")));
  }
}

TEST_F(ApiOfAFolder, ShowsImagesOfArchivesBeneathIt) {
  const auto use = [&](const std::string& pattern) {
    Write("root/session.yaml",
          "plenocal: 1\ntarget: target.yaml\ncameras:\n  left: {model: pinhole, images: " +
              pattern + "}\n");
    return Json::parse(Ask("GET", {"session"}).body);
  };
  testing::WriteZip(folder_ / "root/day.zip",
                    {{"left/1.pgm", testing::FlatImage(7)}, {"left/2.pgm", testing::FlatImage(9)}});
  EXPECT_EQ(use("day.zip/left")["cameras"][0]["frames"], Json({"1", "2"}));
  const Answer image = Ask("GET", {"image", "left", "2"});
  EXPECT_EQ(image.status, 200);
  EXPECT_EQ(image.type, "image/jpeg");
  EXPECT_EQ(Ask("GET", {"image", "left", "3"}).status, 404);

  // As it is now, not as it was.
  fs::remove(folder_ / "root/day.zip");
  testing::WriteZip(folder_ / "root/day.zip", {{"left/3.pgm", testing::FlatImage(7)}});
  fs::last_write_time(folder_ / "root/day.zip",
                      fs::file_time_type::clock::now() + std::chrono::seconds(2));
  EXPECT_EQ(Ask("GET", {"image", "left", "3"}).status, 200);

  testing::WriteZip(folder_ / "outside/day.zip", {{"left/1.pgm", testing::FlatImage(7)}});
  EXPECT_THAT(use("../outside/day.zip/left").dump(), HasSubstr("outside"));
  EXPECT_EQ(Ask("GET", {"image", "left", "1"}).status, 400);
  fs::create_symlink(folder_ / "outside/day.zip", folder_ / "root/link.zip");
  use("link.zip/left");
  EXPECT_EQ(Ask("GET", {"image", "left", "1"}).status, 400) << "a link leads out";
}

TEST_F(ApiOfAFolder, TakesJobsOfItsKinds) {
  for (const char* kind : {"detect", "calibrate", "try"}) {
    const Answer answer = Ask("POST", {"jobs"}, Json{{"kind", kind}}.dump());
    EXPECT_EQ(answer.status, 202) << kind;
    EXPECT_EQ(Json::parse(answer.body)["kind"], kind);
  }
  const Json jobs = jobs_->All();
  ASSERT_EQ(jobs.size(), 3U);
  EXPECT_EQ(jobs[1]["run"], 1) << "a calibration's run has a number";
  EXPECT_EQ(Ask("POST", {"jobs"}, R"({"kind": "bake"})").status, 400);
  EXPECT_EQ(jobs_->All().size(), 3U);
}

TEST_F(ApiOfAFolder, WatchesOnlyWhenAsked) {
  EXPECT_EQ(Json::parse(Ask("GET", {"state"}).body)["watching"], false);
  for (const char* body : {"{}", R"({"on": 1})", R"({"on": "true"})"}) {
    EXPECT_EQ(Ask("POST", {"watch"}, body).status, 400) << body;
  }
  api_->CalibrateArrivals();
  EXPECT_TRUE(jobs_->All().empty());
  EXPECT_EQ(Json::parse(Ask("POST", {"watch"}, R"({"on": true})").body)["watching"], true);
  Write("root/session.yaml", "plenocal: 1\ncameras: [");
  api_->CalibrateArrivals();
  EXPECT_TRUE(jobs_->All().empty()) << "a session that cannot be read is no reason to begin";
  EXPECT_EQ(Json::parse(Ask("POST", {"watch"}, R"({"on": false})").body)["watching"], false);
}

TEST_F(ApiOfAFolder, CalibratesOnceWithImagesThatHaveArrived) {
  EXPECT_EQ(Ask("POST", {"watch"}, R"({"on": true})").status, 200);
  Write("root/left/new.png", "no image");
  for (int look = 0; look < 3; ++look) {
    std::this_thread::sleep_for(std::chrono::milliseconds(505));
    api_->CalibrateArrivals();
  }
  const Json jobs = jobs_->All();
  ASSERT_EQ(jobs.size(), 1U);
  EXPECT_EQ(jobs[0]["kind"], "calibrate");
  EXPECT_EQ(jobs[0]["run"], 1);
}

TEST_F(ApiOfAFolder, GivesNamesOfStrangersAsText) {
  const Json session = Json::parse(Ask("GET", {"session"}).body);
  EXPECT_EQ(session["problem"], nullptr);
  EXPECT_EQ(session["cameras"][0]["frames"][0], "<img src=x onerror=alert(1)>");
  EXPECT_EQ(session["text"], kSession);
}

TEST_F(ApiOfAFolder, ExcludesWhatSuchANameMatches) {
  const std::string rule = Json{{"frame", "<img src=x onerror=alert(1)>"}}.dump();
  ASSERT_EQ(Ask("POST", {"session", "exclude"}, rule).status, 200);
  EXPECT_EQ(Session(),
            std::string(kSession) + "exclude:\n  - {frame: \"<img src=x onerror=alert(1)>\"}\n");
  ASSERT_EQ(Ask("POST", {"session", "include"}, rule).status, 200);
  EXPECT_EQ(Session(), kSession);
}

TEST_F(ApiOfAFolder, RefusesWrongBodiesAndChangesNothing) {
  for (const char* body : {"[]",
                           "{",
                           "\"a\"",
                           "{}",
                           "{\"frame\": 3}",
                           "{\"markers\": \"x\"}",
                           "{\"markers\": [1.5]}",
                           "{\"markers\": [99999999999]}",
                           "{\"markers\": [18446744073709551615]}",
                           "{\"frame\": \"a\", \"camera\": \"nobody\"}"}) {
    EXPECT_EQ(Ask("POST", {"session", "exclude"}, body).status, 400) << body;
  }
  for (const char* body : {"{}", "", "{\"text\": null}", "{\"text\": 5}"}) {
    EXPECT_EQ(Ask("PUT", {"session"}, body).status, 400) << body;
    EXPECT_EQ(Ask("PUT", {"session", "target"}, body).status, 400) << body;
  }
  EXPECT_EQ(Session(), kSession);
  EXPECT_EQ(Ask("POST", {"suggest"}, "{\"run\": \"1\"}").status, 400);
  EXPECT_EQ(Ask("POST", {"suggest"}, "{\"run\": 4294967296}").status, 400);
  EXPECT_EQ(Ask("POST", {"jobs"}, "{\"kind\": \"rm\"}").status, 400);
  EXPECT_EQ(Ask("POST", {"jobs"}, "{\"kind\": \"init\"}").status, 409) << "there is a session";
  EXPECT_EQ(Ask("DELETE", {"jobs", "7"}).status, 404);
  EXPECT_EQ(Ask("GET", {"runs", "7"}).status, 404);
  EXPECT_EQ(Ask("GET", {"runs", "x"}).status, 400);
  for (const char* body : {R"({"model": "fov"})", R"({"model": "fov", "cameras": []})"}) {
    EXPECT_EQ(Ask("POST", {"session", "model"}, body).status, 400) << body;
  }
  EXPECT_EQ(Ask("GET", {"nothing"}).status, 404);
  EXPECT_EQ(Ask("GET", {}).status, 404);
  Write("root/calibration.yaml", "plenocal: 1\n");
  EXPECT_EQ(Ask("GET", {"runs", "0", "focus", "left", "b"}).status, 200);
  EXPECT_EQ(Ask("GET", {"runs", "0", "focus", "left", "b", "focused.png"}).status, 404);
  for (const char* count : {"0", "-3", "101"}) {
    const Answer answer =
        Ask("POST", {"suggest"}, fmt::format("{{\"run\": 0, \"count\": {}}}", count));
    EXPECT_THAT(answer.body, HasSubstr("count")) << count;
  }
  for (const char* format : {"../x", "--help", ".x", ""}) {
    EXPECT_EQ(Ask("GET", {"runs", "0", "export"}, {}, {{"format", format}}).status, 400) << format;
  }
}

TEST_F(ApiOfAFolder, TakesImagesAndRecordingsAlone) {
  const auto add = [&](const char* dir, const char* name) {
    return Ask("POST", {"files"}, "picture", {{"dir", dir}, {"name", name}}).status;
  };
  EXPECT_EQ(add("right", "0001.png"), 201);
  EXPECT_EQ(add("", "recording.mcap"), 201);
  EXPECT_EQ(add("right", "0001.png"), 400) << "it is there already";
  for (const char* name :
       {"session.yaml", "a", ".a.png", "-a.png", "../a.png", "right/a.png", "", "\xfc.png"}) {
    EXPECT_EQ(add("", name), 400) << name;
  }
  for (const char* dir : {"..", "link", ".plenocal", "-o", "right/a", "\xfc"}) {
    EXPECT_EQ(add(dir, "a.png"), 400) << dir;
  }
  EXPECT_EQ(add("\xc3\xbc", "\xc3\xbc.png"), 201);
  EXPECT_THAT(Ask("POST", {"files"}, "picture", {{"dir", ""}, {"name", "\xfc.png"}}).body,
              HasSubstr("'\\\\xfc.png' is not UTF-8; rename it"));
}

TEST_F(ApiOfAFolder, TakesImagesOfASessionsCamera) {
  const auto add = [&](const char* camera, const char* name) {
    return Ask("POST", {"files"}, "picture", {{"camera", camera}, {"name", name}});
  };
  EXPECT_EQ(add("left", "d.png").status, 201);
  EXPECT_TRUE(fs::exists(folder_ / "root/left/d.png"));
  EXPECT_THAT(add("left", "d.png").body, HasSubstr("\"left/d.png: is there already"));
  EXPECT_THAT(add("left", "e.jpg").body, HasSubstr("the session reads left/*.png"));
  EXPECT_THAT(add("left", "day.mcap").body, HasSubstr("the session reads left/*.png"));
  EXPECT_THAT(add("right", "e.png").body, HasSubstr("has no camera 'right'"));
  Write("root/session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  left: {model: fov, images: left/}\n");
  EXPECT_THAT(add("left", "d.jpg").body, HasSubstr("\"left/d.png: is there already"));
  EXPECT_EQ(add("left", "e.jpg").status, 201);
  for (const char* elsewhere : {"link/", "../outside/", "left/b.png"}) {
    Write("root/session.yaml",
          fmt::format("plenocal: 1\ntarget: target.yaml\ncameras:\n  left: {{model: fov, images: "
                      "{}}}\n",
                      elsewhere));
    EXPECT_EQ(add("left", "f.png").status, 400) << elsewhere;
  }
  EXPECT_FALSE(fs::exists(folder_ / "outside/f.png"));
}

TEST_F(ApiOfAFolder, SendsEachChangeAsAnEvent) {
  size_t seen = events_.Last();
  const std::string hash = Json::parse(Ask("GET", {"session"}).body)["hash"];
  EXPECT_EQ(events_.After(&seen), "");
  const std::string text = std::string(kSession) + "# changed\n";
  const Json changed = Json::parse(Ask("PUT", {"session"}, Json{{"text", text}}.dump()).body);
  EXPECT_EQ(changed["text"], text);
  EXPECT_NE(changed["hash"], hash);
  EXPECT_THAT(events_.After(&seen),
              HasSubstr("event: session\ndata: " + Json{{"hash", changed["hash"]}}.dump()));
}

TEST_F(ApiOfAFolder, ChangesValuesByFields) {
  const auto set = [&](const char* of, const Json& path, const char* value) {
    return Ask(
        "POST", {"session", "field"}, Json{{"of", of}, {"path", path}, {"value", value}}.dump());
  };
  const auto target = [&] {
    return Json::parse(Ask("GET", {"session"}).body)["target_text"].get<std::string>();
  };
  EXPECT_EQ(set("session", {"cameras", "left", "model"}, "fov").status, 200);
  EXPECT_THAT(Session(), HasSubstr("left: {model: fov, images: left/*.png}"));
  EXPECT_EQ(set("session", {"options", "refine_target"}, "true").status, 200);
  EXPECT_THAT(Session(), HasSubstr("options:\n  refine_target: true\n"));
  EXPECT_EQ(set("session", {"plenocal"}, "2").status, 400) << "there is no such field";
  EXPECT_EQ(set("session", {"cameras", "left", "model"}, "a}\nb: c").status, 400);

  Write("root/target.yaml",
        "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare:  # measure it\n");
  const Json session = Json::parse(Ask("GET", {"session"}).body);
  EXPECT_THAT(session["problem"].get<std::string>(), ::testing::StartsWith("target.yaml:5:1: "));
  EXPECT_EQ(session["fields"]["target"][3]["value"], "");
  EXPECT_EQ(session["fields"]["target"][3]["unit"], "m");
  EXPECT_EQ(set("target", {"square"}, "25 mm").status, 200);
  EXPECT_EQ(set("target", {"tolerance"}, "0.2 mm").status, 200);
  const std::string with =
      "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\n"
      "square: 25 mm  # measure it\n";
  EXPECT_EQ(target(), with + "tolerance: 0.2 mm\n");
  EXPECT_EQ(set("target", {"tolerance"}, "").status, 200);
  EXPECT_EQ(target(), with);
  EXPECT_EQ(set("target", {"type"}, "circles").status, 200);
  EXPECT_EQ(target(), "plenocal: 1\ntype: circles\ncolumns: 9\nrows: 6\n");

  // A session with a mistake of its own.
  Write("root/session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras:\n  raw:\n    model: focused-plenoptic\n"
        "    pixel_size:  # state it\n    images: left/\n");
  EXPECT_EQ(Json::parse(Ask("GET", {"session"}).body)["fields"]["session"][1]["value"], "");
  EXPECT_EQ(set("target", {"spacing"}, "2 cm").status, 200);
  EXPECT_THAT(target(), HasSubstr("spacing: 2 cm\n"));
  EXPECT_EQ(set("session", {"cameras", "raw", "pixel_size"}, "5.5 um").status, 200);
  EXPECT_THAT(Session(), HasSubstr("    pixel_size: 5.5 um  # state it\n"));
}

TEST_F(ApiOfAFolder, WeighsPicturesOfTheStatedSizesAlone) {
  const auto look = [&](const char* pictures) {
    return Ask("POST", {"look"}, "picture", {{"run", "0"}, {"pictures", pictures}}).body;
  };
  for (const char* pictures : {"",
                               "left",
                               "left:6",
                               "left:8",
                               "left:0",
                               "left:-7",
                               "left:7x",
                               "left:7,right:7",
                               "left:99999999999999999999"}) {
    EXPECT_THAT(look(pictures), HasSubstr("CAMERA:BYTES")) << pictures;
  }
  // There is no calibration here.
  EXPECT_THAT(look("left:7"), HasSubstr("calibration.yaml"));
  EXPECT_EQ(Ask("POST", {"look", "keep"}, R"({"frame": "a"})").status, 200);
  EXPECT_THAT(Ask("POST", {"look", "keep"}, "{}").body, HasSubstr("frame: expected a text"));
}

TEST_F(ApiOfAFolder, TakesAModelIntoTheSession) {
  const auto use = [&](const char* camera, const char* model) {
    return Ask("POST",
               {"session", "model"},
               Json{{"cameras", Json::array({camera})}, {"model", model}}.dump())
        .status;
  };
  EXPECT_EQ(Json::parse(Ask("GET", {"try"}).body), nullptr);
  EXPECT_EQ(use("left", "no-model"), 400);
  EXPECT_EQ(use("right", "fov"), 400);
  EXPECT_EQ(Session(), kSession);
  EXPECT_EQ(use("left", "fov"), 200);
  EXPECT_THAT(Session(), HasSubstr("left: {model: fov, images: left/*.png}"));
}

TEST_F(ApiOfAFolder, ShowsModelsThatTheImagesDoNotDetermine) {
  Write(
      "root/.plenocal/try/try.yaml",
      "plenocal: 1\ncameras: [left, '0']\nframes: 9\nfolds: 3\nrecommended: fov\nwhy: \"the best\"\n"
      "models:\n  fov: {parameters: 5, projection: .inf, judgement: \"recommended\", "
      "held_out: {rms: 0.1, sigma: 0.01, probability: 1}}\n  ucm: {failure: \"too few\"}\n");
  const Json tried = Json::parse(Ask("GET", {"try"}).body);
  EXPECT_EQ(tried["cameras"], Json({"left", "0"}));
  EXPECT_EQ(tried["models"]["fov"]["held_out"]["rms"], 0.1);
  EXPECT_EQ(tried["models"]["fov"]["projection"], nullptr);
  EXPECT_EQ(tried["models"]["ucm"]["failure"], "too few");
  EXPECT_FALSE(tried.contains("target"));
}

TEST_F(ApiOfAFolder, WritesNoTargetThatLiesElsewhere) {
  fs::remove(folder_ / "root/target.yaml");
  fs::create_symlink(folder_ / "outside/secret.png", folder_ / "root/target.yaml");
  EXPECT_EQ(Ask("PUT", {"session", "target"}, "{\"text\": \"mine\"}").status, 400);
  EXPECT_EQ(fs::file_size(folder_ / "outside/secret.png"), 6u);
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
