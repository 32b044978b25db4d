#include "server/quota_options.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "cli/finite_range.h"

namespace tessera::server {
namespace {

constexpr double kMaxQuota = 1e9;
constexpr double kDefaultJobs = 10'000;

struct QuotaOption {
  const char* name;
  const char* help;
};

/// In the order of kQuotaKinds.
constexpr std::array<QuotaOption, kQuotaKinds.size()> kOptions = {{
    {"--client-jobs",
     "Maximum unfinished jobs per client; 0: unlimited (default: 10000 with --certs, else 0)"},
    {"--client-gigasamples",
     "Maximum pixels x samples of a client's unfinished jobs, 10^9; 0: unlimited"},
    {"--client-gb", "Maximum store for a client's unfinished jobs, GB; 0: unlimited"},
    {"--client-stored-gb",
     "Maximum size of a client's scene files and results, including what its unfinished jobs may "
     "need, GB; 0: unlimited (default: half of --quota-gb with --certs, else 0)"},
    {"--client-streams", "With --certs: maximum open streams per client; 0: unlimited"},
    {"--client-event-subscriptions",
     "With --certs: maximum event subscriptions per client; 0: unlimited"},
    {"--client-connections", "With --certs: maximum open connections per client; 0: unlimited"},
    {"--client-concurrent-calls",
     "With --certs: maximum calls in progress per client, excluding streams; 0: unlimited"},
    {"--client-calls", "With --certs: maximum calls per second per client; 0: unlimited"},
    {"--client-upload-gb", "With --certs: maximum upload per client per hour, GB; 0: unlimited"},
}};

absl::Status malformed(const std::string& text, const std::string& what) {
  return absl::InvalidArgumentError(
      absl::StrCat("client-quota: \"", text, "\" is not NAME:QUOTA=VALUE,...: ", what));
}

absl::Status read_override(const std::string& text, ClientQuotas& quotas) {
  const std::vector<std::string> parts = absl::StrSplit(text, absl::MaxSplits(':', 1));
  if (parts.size() != 2 || parts[0].empty()) return malformed(text, "the client's name is missing");
  const auto [entry, is_new] = quotas.by_client.try_emplace(parts[0], quotas.defaults);
  if (!is_new) return malformed(text, "this client is named twice");
  const std::vector<std::string> settings = absl::StrSplit(parts[1], ',');
  for (const std::string& setting : settings) {
    const std::vector<std::string> pair = absl::StrSplit(setting, absl::MaxSplits('=', 1));
    const auto* const kind = std::find_if(kQuotaKinds.begin(), kQuotaKinds.end(),
                                          [&](const auto& each) { return pair[0] == each.name; });
    if (kind == kQuotaKinds.end()) {
      return malformed(text, absl::StrCat("unknown quota \"", pair[0], "\"; expected one of ",
                                          absl::StrJoin(kQuotaKinds, ", ",
                                                        [](std::string* out, const auto& each) {
                                                          out->append(each.name);
                                                        })));
    }
    double value = 0;
    if (pair.size() != 2 || !absl::SimpleAtod(pair[1], &value) || !(value >= 0) ||
        !(value <= kMaxQuota)) {
      return malformed(text, absl::StrCat(kind->name, " needs a value of 0 to 1e9"));
    }
    entry->second.*kind->member = value;
  }
  return absl::OkStatus();
}

}  // namespace

void add_quota_options(CLI::App& app, QuotaOptions& options) {
  for (std::size_t i = 0; i < kQuotaKinds.size(); ++i) {
    CLI::Option* const option =
        app.add_option(kOptions[i].name, options.defaults.*kQuotaKinds[i].member, kOptions[i].help)
            ->check(cli::finite_range(0.0, kMaxQuota));
    if (!absl::StrContains(kOptions[i].help, "(default")) option->capture_default_str();
  }
  app.add_option("--client-quota", options.by_client,
                 "Quotas of one client in place of the defaults, such as "
                 "ann:jobs=200,stored-gb=500; QUOTA as in --client-QUOTA; repeatable")
      ->type_name("NAME:QUOTA=VALUE,...")
      ->allow_extra_args(false)
      ->check([](const std::string& text) {
        return std::string(parse_quotas({{}, {text}}).status().message());
      });
}

void complete_quotas(const CLI::App& app, double store_gb, ClientQuota& defaults) {
  if (app.get_option("--client-jobs")->empty()) defaults.jobs = kDefaultJobs;
  if (app.get_option("--client-stored-gb")->empty()) defaults.stored_gb = store_gb / 2;
}

absl::StatusOr<ClientQuotas> parse_quotas(const QuotaOptions& options) {
  ClientQuotas quotas{options.defaults, {}};
  for (const std::string& text : options.by_client) {
    if (absl::Status status = read_override(text, quotas); !status.ok()) return status;
  }
  return quotas;
}

}  // namespace tessera::server
