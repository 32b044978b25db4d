#include "client/api/client_certificate.h"

#include <unistd.h>

#include <cstdio>
#include <utility>

#include "absl/strings/str_cat.h"
#include "rpc/certificates/certificate_files.h"

namespace tessera::client {
namespace {

/// The server's clock may be ahead of this one.
constexpr std::chrono::seconds kClockSkew{5};

}  // namespace

ClientCertificate::ClientCertificate(std::string folder,
                                     std::function<std::shared_ptr<grpc::Channel>()> channel)
    : folder_(std::move(folder)), path_(folder_ + "/tls.crt"), channel_(std::move(channel)) {
  note_connected();
}

void ClientCertificate::start(std::chrono::milliseconds timeout) {
  if (renewer_ != nullptr) return;
  const std::string authority =
      contract::file_expiry_warning(folder_ + "/ca.crt", WallTime::clock::now());
  if (!authority.empty()) warn(authority);
  contract::CertificateRenewer::Options options;
  options.folder = folder_;
  options.channel = channel_;
  options.renewed = [] {};  // is_replaced() sees the files
  options.failed = [this](const absl::Status& status) { note_failure(status); };
  renewer_ = std::make_unique<contract::CertificateRenewer>(std::move(options));
  if (due_ <= WallTime::clock::now()) renewer_->await_first_look(timeout);
}

bool ClientCertificate::is_replaced(WallTime now) const {
  if (now < due_) return false;
  const auto stored = contract::certificate_end(path_);
  return stored.ok() && *stored != end_;
}

void ClientCertificate::note_connected() {
  due_ = contract::renewal_time(folder_).value_or(WallTime::max());
  end_ = contract::certificate_end(path_).value_or(WallTime::max());
}

absl::Status ClientCertificate::explain(const absl::Status& failure, WallTime now) const {
  const bool may_be_due = absl::IsUnavailable(failure) || absl::IsUnauthenticated(failure) ||
                          absl::IsCancelled(failure);
  const auto end = contract::certificate_end(path_);
  if (!may_be_due || !end.ok()) return failure;
  const auto slack = absl::IsUnauthenticated(failure) ? kClockSkew : std::chrono::seconds(0);
  if (now + slack < *end) return failure;
  return absl::UnauthenticatedError(absl::StrCat(path_, ": the certificate expired at ",
                                                 contract::date_text(*end), "; ", how_to_replace(),
                                                 " (", std::string(failure.message()), ")"));
}

/// Warns of a failed attempt in the last three weeks of the certificate, unless another process
/// renews it or the server does not answer, which the calls of the program report.
void ClientCertificate::note_failure(const absl::Status& status) {
  const auto end = contract::certificate_end(path_);
  if (absl::IsUnavailable(status) || !end.ok()) return;
  const WallTime now = WallTime::clock::now();
  if (*end <= now) return;  // calls fail and report it
  if (contract::file_expiry_warning(path_, now).empty()) return;
  const bool is_writable = ::access(folder_.c_str(), W_OK) == 0;
  warn(absl::StrCat(path_, ": the certificate expires at ", contract::date_text(*end),
                    " and cannot be renewed: ", std::string(status.message()), "; ",
                    is_writable ? "" : "make the directory writable for this user, or ",
                    how_to_replace()));
}

void ClientCertificate::warn(const std::string& text) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(last_warning_, text) == text) return;
  }
  std::fprintf(stderr, "warning: %s\n", text.c_str());
}

std::string ClientCertificate::how_to_replace() const {
  const std::string holder = contract::certificate_holder(path_);
  const std::size_t slash = holder.find('/');
  const bool is_known = slash != std::string::npos;
  return absl::StrCat("get a new one from the operator: `tessera-server issue-cert CERTS --role ",
                      is_known ? holder.substr(0, slash) : "ROLE", " --name ",
                      is_known ? holder.substr(slash + 1) : "NAME",
                      " --out NEW`, then move NEW/tls.key and NEW/tls.crt to ", folder_);
}

}  // namespace tessera::client
