// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/api.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "apps/workbench/focus_json.h"
#include "apps/workbench/image_answer.h"
#include "apps/workbench/project/beneath.h"
#include "apps/workbench/project/child.h"
#include "apps/workbench/project/session_text.h"
#include "apps/workbench/run_json.h"
#include "apps/workbench/try_json.h"
#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/files/frame_images.h"
#include "calib/io/detection_cache.h"
#include "engine/recording/stores/image_lister.h"
#include "models/registry.h"
#include "targets/target.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr size_t kMostText = 1024 * 1024;
constexpr const char* kTry = ".plenocal/try";           // in the root
constexpr const char* kDrawings = ".plenocal/drawing";  // in the root

Answer JsonAnswer(const Json& json, int status = 200) {
  return {.status = status, .body = json.dump(-1, ' ', false, Json::error_handler_t::replace)};
}

Json BodyOf(const Request& request) {
  Json body = Json::parse(request.body.empty() ? "{}" : request.body, nullptr, false);
  if (!body.is_object()) throw InputError("the request's body is no JSON object");
  return body;
}

std::string TextOf(const Json& body, const char* key) {
  const auto found = body.find(key);
  if (found == body.end() || found->is_null()) return {};
  if (!found->is_string()) {
    throw InputError("{}: expected text", key);
  }
  return found->get<std::string>();
}

int NumberOf(const std::string& text, const char* what) {
  int number = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), number);
  if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size() || number < 0) {
    throw InputError("{}: expected a number, got '{}'", what, text);
  }
  return number;
}

bool Is(const Request& request, const char* method, std::initializer_list<const char*> path) {
  if (request.method != method || request.path.size() != path.size() + 1) return false;
  size_t i = 1;
  for (const char* part : path) {
    if (std::string_view(part) != "*" && request.path[i] != part) return false;
    ++i;
  }
  return true;
}

// A name that is no option and no path.
std::string PlainName(const std::string& name, const char* what) {
  if (name.empty() || name.starts_with('-') || name.starts_with('.') ||
      name.find('/') != std::string::npos) {
    throw InputError("{}: '{}' is no name", what, name);
  }
  return name;
}

// A whole number of a body.
int NumberOf(const Json& body, const char* key, int otherwise) {
  const auto found = body.find(key);
  if (found == body.end()) return otherwise;
  if (!found->is_number_integer()) {
    throw InputError("{}: expected a number", key);
  }
  return found->get<int>();
}

ExcludeRule RuleOf(const Json& body) {
  ExcludeRule rule{.camera = TextOf(body, "camera"),
                   .frame = TextOf(body, "frame"),
                   .note = TextOf(body, "note")};
  if (const auto markers = body.find("markers"); markers != body.end()) {
    if (!markers->is_array()) throw InputError("markers: expected a list");
    for (const Json& marker : *markers) {
      if (!marker.is_number_integer()) throw InputError("markers: expected numbers");
      rule.markers.push_back(marker.get<int>());
    }
  }
  if (rule.frame.empty() && rule.markers.empty()) {
    throw InputError("give the frame or the markers to exclude");
  }
  return rule;
}

// Of the results of `focus`, in the root.
fs::path FocusFolder(int run, const std::string& camera, const std::string& frame) {
  return fs::path(".plenocal") / "focus" / std::to_string(run) / camera / frame;
}

// What a command printed, or its message as an error.
std::string OutputOf(const ChildResult& child) {
  if (child.status == 0) return child.out;
  throw Error(ErrorKind::kJob, FailureOf(child));
}

}  // namespace

Api::Api(Project* project, Jobs* jobs, EventLog* events)
    : project_(project), jobs_(jobs), events_(events), images_(project->Root()), watch_(project) {}

Answer Api::Handle(const Request& request) {
  if (Is(request, "GET", {"state"})) return State();
  if (Is(request, "GET", {"files"})) return Files(request);
  if (Is(request, "POST", {"files"})) return AddImage(request);
  if (Is(request, "POST", {"look"})) return Look(request);
  if (Is(request, "POST", {"look", "keep"})) {
    live_.Keep();
    return JsonAnswer(Json::object());
  }
  if (request.path.size() >= 2 && request.path[1] == "session") return SessionRequest(request);
  if (Is(request, "POST", {"jobs"})) return AddJob(request);
  if (Is(request, "POST", {"watch"})) return WatchRequest(request);
  if (Is(request, "DELETE", {"jobs", "*"})) {
    const bool stopped = jobs_->Stop(NumberOf(request.path[2], "job"));
    return stopped ? JsonAnswer(Json::object()) : ErrorAnswer(404, "no such job is running");
  }
  if (Is(request, "GET", {"image", "*", "*"})) return Image(request);
  if (request.method == "GET" && request.path.size() >= 3 && request.path[1] == "runs") {
    return Run(request);
  }
  if (Is(request, "POST", {"suggest"})) return Suggest(request);
  if (Is(request, "GET", {"compare"})) return Compare(request);
  if (Is(request, "GET", {"try"})) return Tried();
  if (Is(request, "POST", {"drawing"})) return DrawTarget();
  if (Is(request, "GET", {"drawing", "*", "*"})) return Sheet(request);
  return ErrorAnswer(404, "the workbench has no such address");
}

Answer Api::State() {
  Json session = nullptr;
  if (project_->HasSession()) {
    const SessionVersion version = project_->ReadVersion();
    session = {{"path", project_->SessionFile().string()},
               {"hash", version.hash},
               {"undo", version.undo},
               {"redo", version.redo}};
  }
  Json runs = Json::array();
  for (const int run : project_->Runs())
    runs.push_back(RunBriefJson(project_->RunFolder(run), run));
  return JsonAnswer({{"root", project_->Root().string()},
                     {"session", session},
                     {"jobs", jobs_->All()},
                     {"runs", runs},
                     {"watching", watch_.On()},
                     {"event", events_->Last()}});
}

// Folders with images beneath the root, to begin with.
Answer Api::Files(const Request& request) const {
  std::error_code error;
  const fs::path folder = fs::canonical(project_->Root() / request.Query("dir"), error);
  // No link leads out of the root.
  (void)RelativeTo(project_->Root(), folder);
  Json entries = Json::array();
  constexpr size_t kMost = 10'000;
  size_t images = 0;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with('.') || entries.size() > kMost) continue;
    if (entry.is_directory(error) && !entry.is_symlink(error)) {
      size_t count = 0;
      for (const auto& file : fs::directory_iterator(entry.path(), error)) {
        if (HasImageName(file.path())) ++count;
      }
      entries.push_back({{"name", name}, {"kind", "dir"}, {"count", count}});
    } else if (HasImageName(entry.path())) {
      ++images;
    } else if (!entry.is_symlink(error) && !SplitStorePattern(entry.path()).file.empty()) {
      entries.push_back({{"name", name}, {"kind", "recording"}, {"count", 1}});
    }
  }
  return JsonAnswer({{"dir", request.Query("dir")}, {"images", images}, {"entries", entries}});
}

// An image or a recording of the page's machine. A name that no session could read is refused.
Answer Api::AddImage(const Request& request) const {
  const std::string folder = request.Query("dir"), name = PlainName(request.Query("name"), "name");
  if (!folder.empty()) (void)PlainName(folder, "dir");
  for (const std::string& each : {folder, name}) {
    const auto defect = each.empty() ? std::nullopt : FrameNameDefect(each);
    if (!defect) continue;
    throw InputError("the name '{}' {}; rename it", each, *defect);
  }
  if (!HasImageName(name) && !IsStoreName(name)) {
    throw InputError("{}: is no image and no recording", name);
  }
  AddBeneath(project_->Root(), folder, name, request.body);
  return JsonAnswer(Json::object(), 201);
}

// The folder directly beneath the root to which an image of the camera can be added as a PNG file;
// null: none.
Json Api::PngFolder(const SessionCamera& camera) const {
  if (camera.images.size() != 1) return nullptr;
  fs::path folder = project_->Root() / camera.images.front();
  const std::string files = folder.filename().string();
  if (files.empty() || files == "*.png" || files == "*") folder = folder.parent_path();
  const std::string name = folder.lexically_relative(project_->Root()).string();
  const bool is_plain = name.find_first_of("/*?[") == std::string::npos && !name.starts_with('.');
  return is_plain && !name.empty() && fs::is_directory(folder) ? Json(name) : Json(nullptr);
}

Json Api::CamerasJson(const Session& session) {
  Json cameras = Json::array();
  for (const SessionCamera& camera : session.cameras) {
    Json frames = Json::array();
    if (!camera.images.empty()) {
      for (const FrameImage& image : images_.Of(camera)) frames.push_back(image.frame);
    }
    cameras.push_back({{"name", camera.name},
                       {"model", camera.model->name},
                       {"plenoptic", camera.model->plenoptic},
                       {"frames", frames},
                       {"folder", PngFolder(camera)}});
  }
  return cameras;
}

Answer Api::SessionAnswer(const SessionVersion& version) {
  Json json = {{"text", version.text},
               {"hash", version.hash},
               {"undo", version.undo},
               {"redo", version.redo},
               {"cameras", Json::array()},
               {"exclude", Json::array()},
               {"target", nullptr},
               {"target_text", nullptr},
               {"problem", nullptr}};
  try {
    const Session session = ParseSession(version.text, project_->SessionFile(), CameraModels());
    for (const ExcludeRule& rule : session.exclude) {
      json["exclude"].push_back({{"camera", rule.camera},
                                 {"frame", rule.frame},
                                 {"markers", rule.markers},
                                 {"note", rule.note}});
    }
    if (IsBeneath(project_->Root(), session.target.file)) {
      json["target"] = RelativeTo(project_->Root(), session.target.file).string();
      const auto text = ReadBeneath(project_->Root(), session.target.file, kMostText);
      json["target_text"] = std::string(text.begin(), text.end());
    }
    json["cameras"] = CamerasJson(session);
    if (!session.scene) (void)ReadTarget(session.target);
  } catch (const Error& error) {
    json["problem"] = Escaped(error.what());
  }
  return JsonAnswer(json);
}

Answer Api::Changed(const std::optional<SessionVersion>& version) {
  if (!version) {
    return ErrorAnswer(
        409, "the session has changed meanwhile", "look at the new text, then change it again");
  }
  events_->Add("session", Json{{"hash", version->hash}}.dump());
  return SessionAnswer(*version);
}

Answer Api::SessionRequest(const Request& request) {
  if (!project_->HasSession()) {
    return ErrorAnswer(404, "there is no session yet", "propose one from the images");
  }
  if (Is(request, "GET", {"session"})) return SessionAnswer(project_->ReadVersion());
  if (Is(request, "PUT", {"session"})) {
    return Changed(project_->Write(TextOf(BodyOf(request), "text"), request.Header("if-match")));
  }
  if (Is(request, "PUT", {"session", "target"})) {
    const Session session = project_->Parsed();
    const fs::path file = project_->Root() / RelativeTo(project_->Root(), session.target.file);
    // Read first: so it is a file beneath the root to which no link leads.
    (void)ReadBeneath(project_->Root(), file, kMostText);
    project_->WriteFile(file, TextOf(BodyOf(request), "text"));
    return Changed(project_->ReadVersion());
  }
  if (Is(request, "POST", {"session", "undo"})) return Changed(project_->Undo());
  if (Is(request, "POST", {"session", "redo"})) return Changed(project_->Redo());
  if (Is(request, "POST", {"session", "exclude"}) || Is(request, "POST", {"session", "include"})) {
    return Exclude(request);
  }
  if (Is(request, "POST", {"session", "model"})) return UseModel(request);
  return ErrorAnswer(404, "the workbench has no such address");
}

Answer Api::UseModel(const Request& request) {
  const Json body = BodyOf(request);
  const std::string model = TextOf(body, "model");
  const auto cameras = body.find("cameras");
  if (cameras == body.end() || !cameras->is_array()) {
    throw InputError("cameras: expected a list");
  }
  const SessionVersion now = project_->ReadVersion();
  std::string text = now.text;
  for (const Json& camera : *cameras) {
    if (!camera.is_string()) throw InputError("cameras: expected names");
    text = WithModel(text, camera.get<std::string>(), model);
  }
  // A text that cannot be read is not written.
  (void)ParseSession(text, project_->SessionFile(), CameraModels());
  return Changed(project_->Write(text, now.hash));
}

// Results of the last `try`; null before there are any.
Answer Api::Tried() const {
  std::error_code error;
  const fs::path folder = project_->Root() / kTry;
  if (!fs::exists(folder / "try.yaml", error)) return JsonAnswer(nullptr);
  return JsonAnswer(TryJson(project_->Root(), folder));
}

Answer Api::Exclude(const Request& request) {
  const ExcludeRule rule = RuleOf(BodyOf(request));
  const SessionVersion now = project_->ReadVersion();
  const std::string text =
      request.path[2] == "exclude" ? WithRule(now.text, rule) : WithoutRule(now.text, rule);
  // A text that cannot be read is not written.
  (void)ParseSession(text, project_->SessionFile(), CameraModels());
  return Changed(project_->Write(text, now.hash));
}

Answer Api::AddJob(const Request& request) {
  const Json body = BodyOf(request);
  const std::string kind = TextOf(body, "kind");
  const std::string session = project_->SessionFile().filename().string();
  const std::string events = std::to_string(kEventsFile);
  Json job;
  if (kind == "init") {
    if (project_->HasSession()) {
      return ErrorAnswer(409, "there is a session already", "edit its text");
    }
    job = jobs_->Add(kind, {"init", ".", "-o", session});
  } else if (kind == "detect") {
    job = jobs_->Add(kind,
                     {"detect",
                      session,
                      "-o",
                      ".plenocal/detections",
                      "--cache",
                      ".plenocal/cache",
                      "--events",
                      events,
                      "--quiet"});
  } else if (kind == "calibrate") {
    job = AddCalibration(project_->NextRun());
  } else if (kind == "focus") {
    job = jobs_->Add(kind, FocusArguments(body));
  } else if (kind == "try") {
    job = jobs_->Add(kind, {"try", session, "-o", kTry, "--quiet"});
  } else {
    return ErrorAnswer(400, fmt::format("'{}' is no kind of job", kind));
  }
  return JsonAnswer(job, 202);
}

Json Api::AddCalibration(int run) {
  return jobs_->Add("calibrate",
                    {"calibrate",
                     project_->SessionFile().filename().string(),
                     "-o",
                     fmt::format("runs/{}", run),
                     "--cache",
                     ".plenocal/cache",
                     "--events",
                     std::to_string(kEventsFile),
                     "--quiet"},
                    {{"run", run}});
}

Answer Api::WatchRequest(const Request& request) {
  const Json body = BodyOf(request);
  const auto on = body.find("on");
  if (on == body.end() || !on->is_boolean()) {
    throw InputError("on: expected true or false");
  }
  if (!on->get<bool>()) {
    watch_.Stop();
  } else if (!watch_.On()) {
    (void)project_->Parsed();  // a session that cannot be read is refused
    watched_run_ = project_->NextRun();
    watch_.Start();
  }
  events_->Add("reset", "{}");  // other tabs show it, too
  return State();
}

// What the pictures of the live cameras add to a run.
Answer Api::Look(const Request& request) {
  const fs::path folder = project_->RunFolder(NumberOf(request.Query("run"), "run"));
  return JsonAnswer(live_.Weigh(folder, request.Query("pictures"), request.body));
}

void Api::CalibrateArrivals() {
  if (!watch_.On() || jobs_->Busy() || !watch_.Arrived()) return;
  events_->Add("session", "{}");
  AddCalibration(watched_run_);
}

Answer Api::Image(const Request& request) {
  const std::string &camera = request.path[2], &frame = request.path[3];
  const auto image = FindImage(camera, frame);
  if (!image) {
    return ErrorAnswer(404, fmt::format("the session has no image {} of {}", frame, camera));
  }
  const int width = request.Query("w").empty() ? 0 : NumberOf(request.Query("w"), "w");
  return ImageAnswer(project_->Root(), *image, width);
}

std::optional<FrameImage> Api::FindImage(const std::string& camera, const std::string& frame) {
  const Session session = project_->Parsed();
  for (const SessionCamera& each : session.cameras) {
    if (each.name != camera) continue;
    for (const FrameImage& image : images_.Of(each)) {
      if (image.frame == frame) return image;
    }
  }
  return std::nullopt;
}

std::filesystem::path Api::RunFile(int run, const std::string& name) const {
  const fs::path file = project_->RunFolder(run) / name;
  // Read first: so it is a file beneath the root to which no link leads.
  (void)ReadBeneath(project_->Root(), file, 512 * kMostText);
  return file;
}

// `focus` of one raw image, with the micro-image centres and the vignetting of a run.
std::vector<std::string> Api::FocusArguments(const Json& body) {
  const int run = NumberOf(body, "run", 0);
  const std::string camera = PlainName(TextOf(body, "camera"), "camera");
  const std::string frame = PlainName(TextOf(body, "frame"), "frame");
  const auto image = FindImage(camera, frame);
  if (!image) {
    throw InputError("the session has no image {} of {}", frame, camera);
  }
  std::vector<std::string> arguments{
      "focus",
      (project_->Root() / RelativeTo(project_->Root(), image->path)).string(),
      "--grid",
      RunFile(run, fmt::format("micro_lenses_{}.csv", camera)).string(),
      "--vignetting",
      RunFile(run, fmt::format("vignetting_{}.tiff", camera)).string(),
      "-o",
      FocusFolder(run, camera, frame).string(),
      "--quiet"};
  if (image->store) {
    throw InputError(
        "{}: the workbench computes virtual depth of image files only; "
        "'plenocal focus' reads recordings",
        image->path.string());
  }
  const Session session = project_->Parsed();
  const auto of = std::ranges::find(session.cameras, camera, &SessionCamera::name);
  if (of->bayer) {
    arguments.insert(arguments.end(), {"--bayer", std::string(BayerName(*of->bayer))});
  }
  return arguments;
}

// The totally focused image and its virtual depth; null where no `focus` has written them.
Answer Api::Focus(const Request& request) const {
  const fs::path folder = FocusFolder(NumberOf(request.path[2], "run"),
                                      PlainName(request.path[4], "camera"),
                                      PlainName(request.path[5], "frame"));
  std::error_code error;
  if (!fs::exists(project_->Root() / folder / "focused.yaml", error)) {
    return JsonAnswer(nullptr);
  }
  if (request.path.size() == 7) {
    return ImageAnswer(
        project_->Root(), {.frame = "", .path = project_->Root() / folder / "focused.png"}, 0);
  }
  return JsonAnswer(FocusJson(project_->Root(), project_->Root() / folder));
}

Answer Api::Run(const Request& request) {
  const int number = NumberOf(request.path[2], "run");
  const fs::path folder = project_->RunFolder(number);
  const std::vector<int> runs = project_->Runs();
  if (std::ranges::find(runs, number) == runs.end()) {
    return ErrorAnswer(404, fmt::format("there is no run {}", number));
  }
  if (request.path.size() == 3) return JsonAnswer(RunJson(folder, number));
  if (Is(request, "GET", {"runs", "*", "points"})) {
    return JsonAnswer(PointsJson(folder, request.Query("camera"), request.Query("frame")));
  }
  if (Is(request, "GET", {"runs", "*", "residuals"})) {
    return JsonAnswer(ResidualsJson(folder, request.Query("camera")));
  }
  if (Is(request, "GET", {"runs", "*", "lenses"})) {
    const std::string camera = PlainName(request.Query("camera"), "camera");
    return JsonAnswer(
        LensesJson(folder, camera, RunFile(number, fmt::format("micro_lenses_{}.csv", camera))));
  }
  if (Is(request, "GET", {"runs", "*", "focus", "*", "*"}) ||
      Is(request, "GET", {"runs", "*", "focus", "*", "*", "focused"})) {
    return Focus(request);
  }
  if (Is(request, "GET", {"runs", "*", "influence"})) return JsonAnswer(InfluenceJson(folder));
  if (Is(request, "GET", {"runs", "*", "preview"})) {
    const Session session = project_->Parsed();
    return JsonAnswer(PreviewJson(folder, session, [&](const std::string& camera) {
      const auto of = std::ranges::find(session.cameras, camera, &SessionCamera::name);
      return of == session.cameras.end() || of->images.empty() ? std::vector<FrameImage>()
                                                               : images_.Of(*of);
    }));
  }
  if (Is(request, "GET", {"runs", "*", "space"})) return JsonAnswer(SpaceJson(folder));
  if (Is(request, "GET", {"runs", "*", "maps"})) {
    return JsonAnswer(MapsJson(folder, request.Query("camera")));
  }
  if (Is(request, "GET", {"runs", "*", "report.html"})) {
    const auto page = ReadBeneath(project_->Root(), folder / "report.html", 512 * kMostText);
    return {.type = "application/octet-stream",
            .body = std::string(page.begin(), page.end()),
            .headers = {{"Content-Disposition", "attachment; filename=report.html"}}};
  }
  if (Is(request, "GET", {"runs", "*", "export"})) return Export(request);
  return ErrorAnswer(404, "the workbench has no such address");
}

Answer Api::Suggest(const Request& request) const {
  const Json body = BodyOf(request);
  const int run = NumberOf(body, "run", 0), count = NumberOf(body, "count", 5);
  return {.body = OutputOf(RunChild({"suggest",
                                     project_->RunFolder(run).string(),
                                     "--count",
                                     std::to_string(count),
                                     "--json",
                                     "--quiet"},
                                    project_->Root().string()))};
}

Answer Api::Compare(const Request& request) const {
  const auto file = [&](const char* name) {
    return (project_->RunFolder(NumberOf(request.Query(name), name)) / "calibration.yaml").string();
  };
  const std::vector<std::string> arguments{"compare", file("a"), file("b")};
  std::string text = OutputOf(RunChild(arguments, project_->Root().string()));
  return JsonAnswer({{"command", CommandLineText(arguments)},
                     {"text", std::move(text)},
                     {"maps",
                      DifferenceJson(fs::path(arguments[1]).parent_path(),
                                     fs::path(arguments[2]).parent_path())}});
}

// The file of another program, with the command line that makes it.
Answer Api::Export(const Request& request) const {
  const int run = NumberOf(request.path[2], "run");
  const std::string format = PlainName(request.Query("format"), "format");
  const fs::path out = project_->Root() / ".plenocal" / "export";
  std::vector<std::string> arguments{"export",
                                     (project_->RunFolder(run) / "calibration.yaml").string(),
                                     "--format",
                                     format,
                                     "-o",
                                     (out / (format + ".txt")).string()};
  if (!request.Query("camera").empty()) {
    arguments.insert(arguments.end(), {"--camera", PlainName(request.Query("camera"), "camera")});
  }
  fs::create_directories(out);
  OutputOf(RunChild(arguments, project_->Root().string()));
  const auto content = ReadBeneath(project_->Root(), out / (format + ".txt"), 64 * kMostText);
  return JsonAnswer({{"command", CommandLineText(arguments)},
                     {"text", std::string(content.begin(), content.end())}});
}

// The target as it is printed: its sheets, or why there is none. Each text of the target has a
// folder.
Answer Api::DrawTarget() {
  const std::lock_guard lock(drawing_);
  const Session session = project_->Parsed();
  const auto without = [](const std::string& why) {
    return JsonAnswer({{"folder", ""}, {"sheets", Json::array()}, {"why", why}});
  };
  if (session.target.file.empty()) {
    return without("the target stands in the session; one in a file of its own is drawn here");
  }
  const std::string text = session.target.Text();
  const std::string name = HashBytes(std::vector<std::uint8_t>(text.begin(), text.end()));
  const fs::path folder = project_->Root() / kDrawings / name;
  if (!fs::exists(folder)) {
    const fs::path made = folder.string() + ".partial";
    fs::remove_all(made);
    fs::create_directories(made);
    try {
      OutputOf(RunChild(
          {"target", session.target.file.string(), "-o", (made / "target.svg").string(), "--quiet"},
          project_->Root().string()));
    } catch (const Error& error) {
      return without(error.what());
    }
    fs::rename(made, folder);
  }
  std::vector<std::string> sheets;
  for (const auto& file : fs::directory_iterator(folder)) {
    sheets.push_back(file.path().filename().string());
  }
  // target-10.svg after target-9.svg.
  std::ranges::sort(
      sheets, {}, [](const std::string& sheet) { return std::pair(sheet.size(), sheet); });
  return JsonAnswer({{"folder", name}, {"sheets", sheets}, {"why", nullptr}});
}

Answer Api::Sheet(const Request& request) const {
  const fs::path file = project_->Root() / kDrawings / PlainName(request.path[2], "folder") /
                        PlainName(request.path[3], "sheet");
  const auto content = ReadBeneath(project_->Root(), file, 64 * kMostText);
  return {.type = "image/svg+xml", .body = std::string(content.begin(), content.end())};
}

}  // namespace plenocal::workbench
