// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/workbench_request.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>
#include <string>

#include "apps/workbench/api.h"
#include "calib/base/error.h"

namespace plenocal::fuzz {
namespace {

namespace fs = std::filesystem;
using workbench::Answer;
using workbench::Request;

constexpr const char* kToken = "secret";

// The folder of a workbench, new for each request.
class Root {
 public:
  Root() : path_(fmt::format("/dev/shm/plenocal_fuzz_{}_root", getpid())) {
    fs::remove_all(path_);
    fs::create_directories(path_ / "left");
    Write("session.yaml",
          "plenocal: 1\ntarget: target.yaml\ncameras:\n"
          "  left: {model: pinhole-radtan, images: left/*.png}\n");
    Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 0.025\n");
    Write("left/a.png", "no image");
    fs::create_symlink("/etc/passwd", path_ / "left/b.png");
  }
  ~Root() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  Root(const Root&) = delete;
  Root& operator=(const Root&) = delete;

  [[nodiscard]] const fs::path& Path() const { return path_; }

 private:
  void Write(const char* name, const char* text) const { std::ofstream(path_ / name) << text; }

  fs::path path_;
};

// The request, and how often the header Host was there.
std::pair<Request, size_t> ParseRequest(std::istream* file, std::string* target) {
  Request request;
  size_t hosts = 0;
  std::string line;
  std::getline(*file, line);
  const size_t space = line.find(' ');
  request.method = line.substr(0, space);
  *target = space == std::string::npos ? "" : line.substr(space + 1);
  while (std::getline(*file, line) && !line.empty()) {
    const size_t colon = line.find(": ");
    std::string name = line.substr(0, colon);
    std::ranges::transform(
        name, name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    hosts += name == "host" ? 1 : 0;
    request.headers[name] = colon == std::string::npos ? "" : line.substr(colon + 2);
  }
  request.body = {std::istreambuf_iterator<char>(*file), {}};
  return {request, hosts};
}

// Starts the worker, takes long, or writes files.
bool StartsWork(const Request& request) {
  const std::set<std::string> work{"jobs", "suggest", "compare", "drawing", "watch"};
  return (request.path.size() > 1 && request.method != "GET" && work.contains(request.path[1])) ||
         (request.path.size() > 1 && request.path[1] == "compare") ||
         (request.path.size() > 3 && request.path[3] == "export");
}

}  // namespace

void AnswerWorkbenchRequest(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string target;
  auto [request, hosts] = ParseRequest(&file, &target);
  auto address = workbench::ParseAddress(target);
  if (!address) throw Error(ErrorKind::kInput, "no address");
  request.path = std::move(address->path);
  request.query = std::move(address->query);
  if (workbench::Refuse(request, hosts, kToken)) throw Error(ErrorKind::kInput, "refused");
  if (request.path.empty() || request.path[0] != "api" || StartsWork(request)) return;
  const Root root;
  workbench::EventLog events;
  workbench::Project project(root.Path());
  workbench::Jobs jobs("no program", root.Path(), &events);
  workbench::Api api(&project, &jobs, &events);
  const Answer answer = api.Handle(request);
  const auto has_accounts = [](const std::string& text) {
    return text.find("root:x:0") != std::string::npos;
  };
  // A request that has these words itself gets them back.
  if (has_accounts(answer.body) && !has_accounts(request.body) && !has_accounts(target)) {
    throw std::logic_error("a link has led out of the folder");
  }
  for (const auto& [name, value] : answer.headers) {
    if (value.find_first_of("\r\n") != std::string::npos) {
      throw std::logic_error(fmt::format("the header {} has a line break", name));
    }
  }
  // The session that is left can be read.
  (void)project.Parsed();
}

}  // namespace plenocal::fuzz
