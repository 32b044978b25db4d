#include "webhook/http_poster.h"

#include <curl/curl.h>

#include <atomic>
#include <utility>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"

namespace tessera::client {
namespace {

constexpr long kConnectSeconds = 10;

struct CurlDeleter {
  void operator()(CURL* curl) const { curl_easy_cleanup(curl); }
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
  void operator()(CURLU* url) const { curl_url_cleanup(url); }
};

/// Returns a part of `url`; empty if it has none.
std::string part_of(CURLU* url, CURLUPart part) {
  char* text = nullptr;
  if (curl_url_get(url, part, &text, 0) != CURLUE_OK) return "";
  std::string copy(text);
  curl_free(text);
  return copy;
}

/// Returns SCHEME://HOST[:PORT] for logs: the path of an address is often a secret.
absl::StatusOr<std::string> loggable_address(const std::string& address) {
  const std::unique_ptr<CURLU, CurlDeleter> url(curl_url());
  if (curl_url_set(url.get(), CURLUPART_URL, address.c_str(), 0) != CURLUE_OK) {
    return absl::InvalidArgumentError("--url is not a URL; expected http://… or https://…");
  }
  const std::string scheme = part_of(url.get(), CURLUPART_SCHEME);
  if (scheme != "http" && scheme != "https") {
    return absl::InvalidArgumentError(
        absl::StrCat("--url: unsupported scheme ", scheme, "://; expected http://… or https://…"));
  }
  const std::string port = part_of(url.get(), CURLUPART_PORT);
  return absl::StrCat(scheme, "://", part_of(url.get(), CURLUPART_HOST), port.empty() ? "" : ":",
                      port);
}

std::size_t discard(char*, std::size_t size, std::size_t count, void*) {
  return size * count;
}

/// CURLOPT_XFERINFOFUNCTION, called at least once per second; a value other than 0 ends the
/// transfer.
int should_end(void* is_cancelled, curl_off_t, curl_off_t, curl_off_t, curl_off_t) {
  return static_cast<std::atomic<bool>*>(is_cancelled)->load() ? 1 : 0;
}

bool is_temporary(long response) {
  return response == 408 || response == 425 || response == 429 || response >= 500;
}

class CurlPoster final : public HttpPoster {
 public:
  CurlPoster(const Options& options, std::string receiver)
      : options_(options), receiver_(std::move(receiver)), curl_(curl_easy_init()) {
    CURL* curl = curl_.get();
    curl_easy_setopt(curl, CURLOPT_URL, options_.url.c_str());
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_USERAGENT, "tessera-webhook/" TESSERA_VERSION);
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, kConnectSeconds);
    curl_easy_setopt(curl, CURLOPT_TIMEOUT_MS,
                     static_cast<long>(absl::ToInt64Milliseconds(options_.request_timeout)));
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, &discard);
    curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
    curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, &should_end);
    curl_easy_setopt(curl, CURLOPT_XFERINFODATA, &is_cancelled_);
  }

  absl::Status post(const std::string& body) override {
    CURL* curl = curl_.get();
    const auto headers = headers_of(body);
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers.get());
    curl_easy_setopt(curl, CURLOPT_POSTFIELDS, body.data());
    curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(body.size()));
    const CURLcode code = curl_easy_perform(curl);
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, nullptr);
    retry_after_s_ = 0;
    if (code != CURLE_OK) {
      if (is_cancelled_) return absl::CancelledError("interrupted");
      return absl::UnavailableError(absl::StrCat(receiver_, ": ", curl_easy_strerror(code)));
    }
    long response = 0;
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &response);
    curl_easy_getinfo(curl, CURLINFO_RETRY_AFTER, &retry_after_s_);
    if (response >= 200 && response <= 299) return absl::OkStatus();
    const std::string message = absl::StrCat(receiver_, " responded ", response);
    return is_temporary(response) ? absl::UnavailableError(message)
                                  : absl::FailedPreconditionError(message);
  }

  absl::Duration retry_after() const override { return absl::Seconds(retry_after_s_); }

  void cancel() override { is_cancelled_ = true; }

 private:
  using Headers = std::unique_ptr<curl_slist, CurlDeleter>;

  Headers headers_of(const std::string& body) const {
    Headers headers(curl_slist_append(nullptr, "Content-Type: application/json"));
    if (options_.secret.empty()) return headers;
    const std::string signature = absl::StrCat("Tessera-Signature: sha256=",
                                               contract::hmac_sha256(options_.secret, body).hex());
    return Headers(curl_slist_append(headers.release(), signature.c_str()));
  }

  const Options options_;
  const std::string receiver_;
  const std::unique_ptr<CURL, CurlDeleter> curl_;
  curl_off_t retry_after_s_ = 0;
  std::atomic<bool> is_cancelled_ = false;
};

}  // namespace

absl::StatusOr<std::unique_ptr<HttpPoster>> HttpPoster::create(const Options& options) {
  // Once per process, before other threads use libcurl.
  static const CURLcode ready = curl_global_init(CURL_GLOBAL_DEFAULT);
  if (ready != CURLE_OK) return absl::InternalError(curl_easy_strerror(ready));
  auto receiver = loggable_address(options.url);
  if (!receiver.ok()) return receiver.status();
  return std::make_unique<CurlPoster>(options, *std::move(receiver));
}

}  // namespace tessera::client
