//! Server for viewers: the page, its pictures as server-sent events, and Foxglove's protocol, on a separate
//! single-threaded runtime. It never waits for a viewer: the newest picture replaces the previous one, and a viewer
//! is sent a picture only after it has read the last.

use std::{
    convert::Infallible,
    net::{IpAddr, SocketAddr},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
        mpsc::{Receiver, SyncSender, TrySendError, sync_channel},
    },
    thread::JoinHandle,
    time::Duration,
};

use alight_computer::exit::{CliError, Doing};
use alight_transport::clock::steady_ns;
use axum::{
    Router,
    body::{Body, Bytes},
    extract::{ConnectInfo, Request, State},
    http::{
        HeaderMap, StatusCode,
        header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderName, ORIGIN},
    },
    middleware::{Next, from_fn},
    response::{IntoResponse, Response},
    routing::{get, post},
};
use foxglove::{Context, WebSocketServer};
use tokio::sync::{oneshot, watch};

use crate::view::{
    guard::{Guard, ViewerPeer},
    picture::Picture,
};

/// Maximum number of messages queued for a Foxglove viewer; beyond that the oldest are dropped.
const BACKLOG: usize = 512;
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause before checking again a viewer that has not read the last picture.
const STALL_PAUSE: Duration = Duration::from_millis(100);

#[derive(Clone, Debug)]
pub struct Served {
    pub page: SocketAddr,
    pub foxglove: Option<SocketAddr>,
    pub name: String,
    pub may_order: bool,
}

/// Order from the page, answered with a text of its result.
pub struct PageOrder {
    /// Name of the order; empty for the order of the large button.
    pub name: String,
    pub reply: oneshot::Sender<Result<String, String>>,
}

/// Server that ends when this is dropped.
pub struct Server {
    pictures: watch::Sender<Bytes>,
    camera: watch::Sender<Bytes>,
    viewers: Viewers,
    orders: Receiver<PageOrder>,
    context: Option<Arc<Context>>,
    addresses: Addresses,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Clone, Copy, Debug)]
struct Addresses {
    page: SocketAddr,
    foxglove: Option<SocketAddr>,
}

#[derive(Clone)]
struct Shared {
    pictures: watch::Receiver<Bytes>,
    camera: watch::Receiver<Bytes>,
    viewers: Viewers,
    orders: SyncSender<PageOrder>,
    may_order: bool,
}

#[derive(Clone, Default)]
struct Viewers(Arc<AtomicUsize>);

/// Viewer, counted until it is dropped.
struct Viewer(Viewers);

impl Viewers {
    fn one_more(&self) -> Viewer {
        self.0.fetch_add(1, Ordering::Relaxed);
        Viewer(self.clone())
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Server {
    pub fn start(served: Served) -> Result<Server, CliError> {
        let (pictures, newest) = watch::channel(Bytes::new());
        let (camera, newest_image) = watch::channel(Bytes::new());
        let (give, orders) = sync_channel(1);
        let (stop, stopped) = oneshot::channel();
        let (result, started) = sync_channel(1);
        let viewers = Viewers::default();
        let shared = Shared {
            pictures: newest,
            camera: newest_image,
            viewers: viewers.clone(),
            orders: give,
            may_order: served.may_order,
        };
        let context = served.foxglove.map(|_| Context::new());
        let own = context.clone();
        let thread = std::thread::Builder::new()
            .name("viewers".into())
            .spawn(move || run(&served, own, shared, stopped, &result))
            .doing("starting the viewers' server")?;
        let ended = |_| Err("its thread ended".into());
        let addresses = started.recv().unwrap_or_else(ended).map_err(CliError)?;
        Ok(Server {
            pictures,
            camera,
            viewers,
            orders,
            context,
            addresses,
            stop: Some(stop),
            thread: Some(thread),
        })
    }
    pub fn show(&self, picture: Picture) {
        let picture = Picture {
            clock_s: (steady_ns() / 1_000_000) as f64 / 1e3,
            ..picture
        };
        // All types of a picture have a JSON form.
        let Ok(json) = serde_json::to_string(&picture) else {
            return;
        };
        self.pictures
            .send_replace(format!("data: {json}\n\n").into_bytes().into());
    }
    pub fn show_camera(&self, jpeg: Vec<u8>) {
        self.camera.send_replace(jpeg.into());
    }
    pub fn is_watched(&self) -> bool {
        self.viewers.0.load(Ordering::Relaxed) > 0
    }
    pub fn order(&self) -> Option<PageOrder> {
        self.orders.try_recv().ok()
    }
    pub fn context(&self) -> Option<&Arc<Context>> {
        self.context.as_ref()
    }
    pub fn lines(&self) -> Vec<String> {
        let live = self.addresses.foxglove.map(|a| format!("Foxglove: ws://{a}"));
        core::iter::once(format!("page: {}", self.page_url()))
            .chain(live)
            .collect()
    }
    pub fn page_url(&self) -> String {
        format!("http://{}", self.addresses.page)
    }
    #[cfg(test)]
    pub(super) fn page(&self) -> SocketAddr {
        self.addresses.page
    }
    #[cfg(test)]
    pub(super) fn foxglove(&self) -> Option<SocketAddr> {
        self.addresses.foxglove
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ended = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ended = thread.join();
        }
    }
}

/// Thread of the server: reports whether it has started, and serves until stopped.
fn run(
    served: &Served,
    context: Option<Arc<Context>>,
    shared: Shared,
    stopped: oneshot::Receiver<()>,
    result: &SyncSender<Result<Addresses, String>>,
) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .enable_time()
        .build();
    let runtime = match runtime {
        Ok(runtime) => runtime,
        Err(e) => {
            let _gone = result.send(Err(format!("starting the viewers' server: {e}")));
            return;
        }
    };
    runtime.block_on(async {
        match listen(served, context).await {
            Ok((guard, addresses)) => {
                let _gone = result.send(Ok(addresses));
                let service = router(shared).into_make_service_with_connect_info::<ViewerPeer>();
                tokio::select! {
                    _ended = axum::serve(guard, service) => {}
                    _stopped = stopped => {}
                }
            }
            Err(e) => drop(result.send(Err(e))),
        }
    });
    runtime.shutdown_background();
}

async fn listen(served: &Served, context: Option<Arc<Context>>) -> Result<(Guard, Addresses), String> {
    use axum::serve::Listener;
    let (address, other) = (served.page, "name another address with --listen or view.listen");
    let failed = |e: std::io::Error| format!("showing the page on {address}: {e}; {other}");
    let guard = Guard::listen(address).map_err(failed)?;
    let page = guard.local_addr().map_err(failed)?;
    let mut foxglove = None;
    if let (Some(context), Some(address)) = (context, served.foxglove) {
        let server = WebSocketServer::new()
            .name(&served.name)
            .bind(address.ip().to_string(), address.port())
            .context(&context)
            .message_backlog_size(BACKLOG);
        let started = server.start().await;
        let handle = started.map_err(|e| {
            format!("listening for Foxglove on {address}: {e}; name another with --foxglove or view.foxglove")
        })?;
        foxglove = Some(SocketAddr::new(address.ip(), handle.port()));
    }
    Ok((guard, Addresses { page, foxglove }))
}

fn router(shared: Shared) -> Router {
    const HTML: &str = include_str!("page/view.html");
    const CSS: &str = include_str!("page/view.css");
    const JS: &str = include_str!("page/view.js");
    const WORKER: &str = include_str!("page/worker.js");
    const MANIFEST: &str = include_str!("page/manifest.json");
    const ICON: &str = include_str!("page/icon.svg");
    Router::new()
        .route("/", get(|| async { file("text/html; charset=utf-8", HTML) }))
        .route(
            "/view.css",
            get(|| async { file("text/css; charset=utf-8", CSS) }),
        )
        .route(
            "/view.js",
            get(|| async { file("text/javascript; charset=utf-8", JS) }),
        )
        .route(
            "/worker.js",
            get(|| async { file("text/javascript; charset=utf-8", WORKER) }),
        )
        .route(
            "/manifest.json",
            get(|| async { file("application/manifest+json", MANIFEST) }),
        )
        .route("/icon.svg", get(|| async { file("image/svg+xml", ICON) }))
        .route("/events", get(events))
        .route("/state", get(state))
        .route("/camera.jpg", get(camera))
        .route("/order", post(order))
        .layer(from_fn(complete))
        .with_state(shared)
}

/// Marks the connection as one with a complete request, which takes precedence, and answers only requests by a name
/// that no foreign page can direct to this computer.
async fn complete(ConnectInfo(peer): ConnectInfo<ViewerPeer>, request: Request, next: Next) -> Response {
    peer.has_asked();
    let mut hosts = request.headers().get_all(HOST).iter();
    if hosts.all(|host| host.to_str().is_ok_and(is_local)) {
        next.run(request).await
    } else {
        (
            StatusCode::FORBIDDEN,
            "open the page by the computer's address instead of a name\n",
        )
            .into_response()
    }
}

/// Headers that forbid foreign content, embedding in another page, and caching.
fn headers(content: &'static str) -> [(HeaderName, &'static str); 4] {
    [
        (CONTENT_TYPE, content),
        (CACHE_CONTROL, "no-store"),
        (
            CONTENT_SECURITY_POLICY,
            "default-src 'self'; frame-ancestors 'none'",
        ),
        (HeaderName::from_static("x-content-type-options"), "nosniff"),
    ]
}

fn file(content: &'static str, body: &'static str) -> Response {
    (headers(content), body).into_response()
}

/// Sends the newest picture and all later ones as server-sent events.
async fn events(State(shared): State<Shared>, ConnectInfo(peer): ConnectInfo<ViewerPeer>) -> Response {
    let mut newest = shared.pictures.clone();
    newest.mark_changed();
    let one = (newest, peer, shared.viewers.one_more());
    let stream = futures_util::stream::unfold(one, |(mut newest, peer, viewer)| async move {
        newest.changed().await.ok()?;
        while peer.is_stalled() {
            tokio::time::sleep(STALL_PAUSE).await;
        }
        let picture = newest.borrow_and_update().clone();
        Some((Ok::<Bytes, Infallible>(picture), (newest, peer, viewer)))
    });
    (headers("text/event-stream"), Body::from_stream(stream)).into_response()
}

async fn state(State(shared): State<Shared>) -> Response {
    let newest = shared.pictures.borrow().clone();
    let json = newest
        .strip_prefix(b"data: ")
        .map_or(Bytes::new(), |json| Bytes::copy_from_slice(json.trim_ascii_end()));
    if json.is_empty() {
        return (StatusCode::SERVICE_UNAVAILABLE, "no picture is available yet\n").into_response();
    }
    (headers("application/json"), json).into_response()
}

async fn camera(State(shared): State<Shared>) -> Response {
    let jpeg = shared.camera.borrow().clone();
    if jpeg.is_empty() {
        return (StatusCode::NOT_FOUND, "no image of the camera yet\n").into_response();
    }
    (headers("image/jpeg"), jpeg).into_response()
}

/// Accepts the crew's order, only from the server's own page.
async fn order(State(shared): State<Shared>, given: HeaderMap, name: String) -> Response {
    if let Err(why) = of_own_page(&given) {
        return (StatusCode::FORBIDDEN, why).into_response();
    }
    if !shared.may_order {
        let why = "orders are not given from the page: view.abort is false in the configuration";
        return (StatusCode::FORBIDDEN, why).into_response();
    }
    let (reply, answer) = oneshot::channel();
    match shared.orders.try_send(PageOrder { name, reply }) {
        Ok(()) => {}
        Err(TrySendError::Full(_)) => {
            return (StatusCode::TOO_MANY_REQUESTS, "one is under way").into_response();
        }
        Err(TrySendError::Disconnected(_)) => return StatusCode::SERVICE_UNAVAILABLE.into_response(),
    }
    match tokio::time::timeout(ANSWER_TIMEOUT, answer).await {
        Ok(Ok(Ok(text))) => text.into_response(),
        Ok(Ok(Err(text))) => (StatusCode::CONFLICT, text).into_response(),
        Ok(Err(_)) | Err(_) => {
            let text = "NO ANSWER: it is not known whether the order was taken; give it another way";
            (StatusCode::GATEWAY_TIMEOUT, text).into_response()
        }
    }
}

/// Whether a request comes from this server's page: no other page can give an order, be it by a form, a script or a
/// host name that resolves to this computer.
fn of_own_page(given: &HeaderMap) -> Result<(), &'static str> {
    let one = |name: &HeaderName| {
        let mut all = given.get_all(name).iter();
        let first = all.next().and_then(|v| v.to_str().ok());
        first.filter(|_| all.next().is_none())
    };
    let (Some(host), Some(origin)) = (one(&HOST), one(&ORIGIN)) else {
        return Err("the request has no Origin header");
    };
    if origin.strip_prefix("http://") != Some(host) {
        return Err("the request comes from another page");
    }
    if !is_address(host) {
        return Err("open the page by the computer's address instead of a name, and give the order there");
    }
    Ok(())
}

/// Whether `host` is an IP address or this computer, with or without a port, not a name that others control.
fn is_address(host: &str) -> bool {
    let bare = host.trim_start_matches('[').trim_end_matches(']');
    let name = host.split_once(':').map_or(host, |(name, _)| name);
    host.parse::<SocketAddr>().is_ok() || bare.parse::<IpAddr>().is_ok() || name == "localhost"
}

/// Whether `host` is an address, or a name that only the local network resolves.
fn is_local(host: &str) -> bool {
    let name = host.split_once(':').map_or(host, |(name, _)| name);
    is_address(host) || !name.contains('.') || name.ends_with(".local")
}

#[cfg(test)]
mod tests;
