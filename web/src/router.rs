//! Addresses, and what every request passes before it has an answer.

use crate::{
    access::{self, Access, Visitor},
    live::{self, LiveFarm},
    pages::{self, Shown, action::Action},
    problem::Problem,
    sending::Sending,
    site::Site,
};
use axum::{
    Router,
    extract::{Path, RawQuery, Request, State},
    middleware::{self, Next},
    response::{IntoResponse, Redirect, Response},
    routing::get,
};
use bytes::Bytes;
use coordinator::security::admission::Peer;
use dataset::CompletedView;
use http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use jobqueue::Completion;
use limits::web::{ANSWER_DEADLINE, FORM_BYTES_MAX, QUERY_BYTES_MAX, VIEWER_PIXELS_MAX};
use std::sync::Arc;
use tokio::{sync::watch, time::timeout};

/// Everything that answers need.
pub struct App {
    pub site: Site,
    pub access: Access,
    pub is_encrypted: bool,
    pub sending: Sending,
    pub stopping: watch::Receiver<bool>,
}

type Answer = Result<Response, Problem>;

const OPERATORS_ONLY: &str = "only an operator can do this: sign in with an operator's token";

/// Pages, pictures and the rest, by address.
pub fn router(app: Arc<App>) -> Router {
    let image = "/materials/{material}/views/{view}";
    let of_image = |rest: &str| format!("{image}/{rest}");
    Router::new()
        .route("/", get(first))
        .route("/materials", get(materials))
        .route("/materials/{material}", get(material))
        .route(&of_image("thumbnail.png"), get(thumbnail))
        .route(&of_image("image.png"), get(developed))
        .route(&of_image("image.exr"), get(file))
        .route(&of_image("pixels"), get(pixels))
        .route(&of_image("errors.png"), get(errors))
        .route("/coverage", get(coverage))
        .route("/farm", get(farm))
        .route("/live", get(live))
        .route("/jobs", get(jobs))
        .route("/workers", get(workers))
        .route("/act", get(confirm).post(act))
        .route("/login", get(login).post(sign_in))
        .route("/logout", axum::routing::post(sign_out))
        .route("/style.css", get(pages::assets::style))
        .route("/script.js", get(pages::assets::script))
        .route("/favicon.svg", get(pages::assets::icon))
        .fallback(absent)
        .method_not_allowed_fallback(absent)
        .layer(middleware::from_fn_with_state(Arc::clone(&app), pass))
        .with_state(app)
}

/// What needs no token: nothing of it tells anything of the farm or the dataset.
fn is_public(path: &str) -> bool {
    matches!(
        path,
        "/login" | "/style.css" | "/script.js" | "/favicon.svg"
    )
}

/// Lets a request through, or answers why not; adds what browsers are told.
async fn pass(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let mut response = match admit(&app, request) {
        // Of a stream of events only the begin is waited for.
        Ok(request) => match timeout(ANSWER_DEADLINE, next.run(request)).await {
            Ok(response) => response,
            Err(_) => Problem::busy("this takes too long").into_response(),
        },
        Err(refusal) => *refusal,
    };
    access::headers::protect(response.headers_mut());
    response
}

fn admit(app: &App, mut request: Request) -> Result<Request, Box<Response>> {
    let refuse = |problem: Problem| Box::new(problem.into_response());
    if !app.access.has_tokens() {
        access::check_host(request.headers()).map_err(refuse)?;
    }
    let query = request.uri().query().unwrap_or_default();
    if query.len() > QUERY_BYTES_MAX {
        let sentence = format!("an address has at most {QUERY_BYTES_MAX} bytes after its ?");
        return Err(refuse(Problem::bad(sentence)));
    }
    let changes = !matches!(*request.method(), Method::GET | Method::HEAD);
    if changes {
        access::check_origin(request.headers()).map_err(refuse)?;
    }
    let path = request.uri().path();
    if is_public(path) {
        return Ok(request);
    }
    let Some(visitor) = app.access.visitor(request.headers()) else {
        let to = request.uri().path_and_query().map_or("/", |to| to.as_str());
        return Err(Box::new(if changes || !wants_page(request.headers()) {
            let why = "sign in first: this server wants a token";
            (StatusCode::UNAUTHORIZED, why).into_response()
        } else {
            Redirect::to(&pages::login::address(to)).into_response()
        }));
    };
    if changes && path != "/logout" && visitor != Visitor::Operator {
        return Err(refuse(Problem::forbidden(OPERATORS_ONLY)));
    }
    if let Some(peer) = request.extensions().get::<Peer>() {
        peer.introduce();
    }
    request.extensions_mut().insert(visitor);
    Ok(request)
}

fn wants_page(headers: &HeaderMap) -> bool {
    let accepts = headers.get(header::ACCEPT);
    let accepts = accepts.and_then(|accepts| accepts.to_str().ok());
    accepts.is_some_and(|accepts| accepts.contains("text/html"))
}

/// The page's surroundings for this visitor.
fn shown<'a>(app: &'a App, visitor: Option<&Visitor>) -> Shown<'a> {
    Shown {
        site: &app.site,
        can_sign_out: app.access.has_tokens(),
        visitor: visitor.copied(),
    }
}

async fn first(State(app): State<Arc<App>>) -> Redirect {
    Redirect::to(match app.site.farm {
        Some(_) => "/farm",
        None => "/materials",
    })
}

/// The farm, where there is one.
fn farm_of(app: &App) -> Result<&LiveFarm, Problem> {
    let farm = app.site.farm.as_ref();
    farm.ok_or_else(|| Problem::absent("no farm is at work here: this is a store alone"))
}

async fn farm(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
) -> Answer {
    let seen = farm_of(&app)?.seen().await?;
    Ok(pages::farm::page(&shown(&app, Some(&visitor)), &seen).into_response())
}

async fn live(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
) -> Answer {
    let news = farm_of(&app)?.watch()?;
    Ok(live::stream(
        news,
        live::variant(visitor),
        app.stopping.clone(),
    ))
}

async fn jobs(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
    RawQuery(query): RawQuery,
) -> Answer {
    let wanted = pages::jobs::Wanted::parse(&query.unwrap_or_default())?;
    let answer = wanted.ask(farm_of(&app)?.control()).await?;
    let page = pages::jobs::page(&shown(&app, Some(&visitor)), &wanted, &answer);
    Ok(page.into_response())
}

async fn workers(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
) -> Answer {
    let workers = farm_of(&app)?.workers().await?;
    Ok(pages::workers::page(&shown(&app, Some(&visitor)), &workers).into_response())
}

async fn confirm(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
    RawQuery(query): RawQuery,
) -> Answer {
    farm_of(&app)?;
    if visitor != Visitor::Operator {
        return Err(Problem::forbidden(OPERATORS_ONLY));
    }
    let query = query.unwrap_or_default();
    let action = Action::parse(query.as_bytes())?;
    Ok(action
        .page(&shown(&app, Some(&visitor)), &query)
        .into_response())
}

/// [`admit`] has let only operators through.
async fn act(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
    request: Request,
) -> Answer {
    let control = farm_of(&app)?.control();
    let form = axum::body::to_bytes(request.into_body(), FORM_BYTES_MAX).await;
    let form = form.map_err(|_| {
        Problem::bad(format!(
            "the form is larger than {FORM_BYTES_MAX} bytes, or broke off"
        ))
    })?;
    let action = Action::parse(&form)?;
    let done = action
        .execute(&shown(&app, Some(&visitor)), control)
        .await?;
    Ok(done.into_response())
}

async fn absent() -> Problem {
    Problem::absent("there is no such page")
}

async fn materials(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
    RawQuery(query): RawQuery,
) -> Answer {
    let query = query.unwrap_or_default();
    let page = move |app: &App| Ok(pages::materials::page(&shown(app, Some(&visitor)), &query));
    on_thread(&app, page).await
}

async fn coverage(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
) -> Answer {
    let page = move |app: &App| {
        let page = pages::coverage::page(&shown(app, Some(&visitor)));
        Ok(page.into_response())
    };
    on_thread(&app, page).await
}

async fn material(
    State(app): State<Arc<App>>,
    axum::Extension(visitor): axum::Extension<Visitor>,
    Path(material): Path<String>,
    RawQuery(query): RawQuery,
) -> Answer {
    let material = number("material", &material)?;
    let query = query.unwrap_or_default();
    let page = move |app: &App| {
        let completion = completion(app, material)?;
        let shown = shown(app, Some(&visitor));
        let page = pages::material::page(&shown, material, completion.as_ref(), &query)?;
        Ok(page.into_response())
    };
    on_thread(&app, page).await
}

/// Does what reads the store, or takes a while, on a thread that may.
async fn on_thread<T: Send + 'static>(
    app: &Arc<App>,
    work: impl FnOnce(&App) -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    let working = Arc::clone(app);
    app.site.threads.run(move || work(&working)).await
}

/// A material's completion, if it is complete. Blocks.
fn completion(app: &App, material: u32) -> Result<Option<Completion>, Problem> {
    let completion = app.site.catalogue.completion(material);
    completion.map_err(|error| Problem::broken(error.to_string()))
}

fn number(what: &str, text: &str) -> Result<u32, Problem> {
    let digits = text.bytes().all(|byte| byte.is_ascii_digit());
    let number = text.parse().ok().filter(|_| digits);
    number.ok_or_else(|| Problem::absent(format!("{text:?} is no {what}'s number")))
}

/// A stored image by the numbers in an address.
async fn image(app: &Arc<App>, at: (String, String)) -> Result<(u32, u32, CompletedView), Problem> {
    let (material, view) = (number("material", &at.0)?, number("view", &at.1)?);
    let completion = on_thread(app, move |app| completion(app, material)).await?;
    let completion = completion
        .ok_or_else(|| Problem::absent(format!("material {material} is not complete")))?;
    let views = completion.views.len();
    let image = completion.views.into_iter().nth(view as usize);
    let image = image.ok_or_else(|| {
        Problem::absent(format!("there are views 0 to {}", views.saturating_sub(1)))
    })?;
    Ok((material, view, image))
}

/// An answer that browsers keep, unless they have it: its name is what it was made from.
fn kept(
    app: &App,
    headers: &HeaderMap,
    name: &str,
    kind: &'static str,
    bytes: impl Into<Bytes>,
) -> Answer {
    let tag = format!("\"{name}\"");
    let tag = HeaderValue::from_str(&tag).unwrap_or(HeaderValue::from_static("\"\""));
    let is_there = headers.get(header::IF_NONE_MATCH) == Some(&tag);
    let about = [
        (header::ETAG, tag),
        (
            header::CACHE_CONTROL,
            HeaderValue::from_static("private, no-cache"),
        ),
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
    ];
    if is_there {
        return Ok((StatusCode::NOT_MODIFIED, about).into_response());
    }
    let bytes = bytes.into();
    let length = [(header::CONTENT_LENGTH, HeaderValue::from(bytes.len()))];
    Ok((about, length, app.sending.body(bytes)?).into_response())
}

/// A picture as [`kept`] answers it.
fn png(app: &App, headers: &HeaderMap, name: &str, picture: Arc<[u8]>) -> Answer {
    kept(app, headers, name, "image/png", Bytes::from_owner(picture))
}

async fn thumbnail(
    State(app): State<Arc<App>>,
    Path(at): Path<(String, String)>,
    headers: HeaderMap,
) -> Answer {
    let (.., image) = image(&app, at).await?;
    let picture = app.site.images.thumbnail(&image).await?;
    let name = format!("small-{}", image.digest);
    png(&app, &headers, &name, picture)
}

async fn developed(
    State(app): State<Arc<App>>,
    Path(at): Path<(String, String)>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Answer {
    let (.., image) = image(&app, at).await?;
    let tenths = pages::material::exposure(&query.unwrap_or_default())?;
    let picture = app.site.images.developed(&image, tenths).await?;
    let name = format!("{tenths}-{}", image.digest);
    png(&app, &headers, &name, picture)
}

async fn file(
    State(app): State<Arc<App>>,
    Path(at): Path<(String, String)>,
    headers: HeaderMap,
) -> Answer {
    let (material, view, image) = image(&app, at).await?;
    let bytes = app.site.images.file(&image).await?;
    let name = image.digest.to_string();
    let mut answer = kept(&app, &headers, &name, "image/x-exr", bytes)?;
    let disposition = format!("attachment; filename=\"material-{material}-view-{view}.exr\"");
    if let Ok(disposition) = HeaderValue::from_str(&disposition) {
        let headers = answer.headers_mut();
        headers.insert(header::CONTENT_DISPOSITION, disposition);
    }
    Ok(answer)
}

/// The pixels for the page's script: three 32-bit floats each, little-endian.
async fn pixels(
    State(app): State<Arc<App>>,
    Path(at): Path<(String, String)>,
    headers: HeaderMap,
) -> Answer {
    let (.., image) = image(&app, at).await?;
    let film = &app.site.specification.image;
    if u64::from(film.width) * u64::from(film.height) > VIEWER_PIXELS_MAX {
        let sentence = format!("values are shown of images of at most {VIEWER_PIXELS_MAX} pixels");
        return Err(Problem::absent(sentence));
    }
    let pixels = app.site.images.pixels(&image).await?;
    let bytes: Vec<u8> = pixels
        .as_flattened()
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let name = format!("pixels-{}", image.digest);
    kept(&app, &headers, &name, "application/octet-stream", bytes)
}

async fn errors(
    State(app): State<Arc<App>>,
    Path(at): Path<(String, String)>,
    headers: HeaderMap,
) -> Answer {
    let (material, view, image) = image(&app, at).await?;
    let picture = app.site.images.errors(material, view, &image).await?;
    let name = format!("errors-{}", image.digest);
    png(&app, &headers, &name, picture)
}

async fn login(
    State(app): State<Arc<App>>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let to = pages::login::target(&query.unwrap_or_default());
    if app.access.visitor(&headers).is_some() {
        return Redirect::to(&to).into_response();
    }
    pages::login::page(&to, None).into_response()
}

async fn sign_in(State(app): State<Arc<App>>, request: Request) -> Answer {
    let form = pages::login::read(request.into_body()).await?;
    match app.access.sign_in(&form.token) {
        Ok(cookie) => {
            let cookie = session_cookie(&app, &cookie, limits::web::SESSION.as_secs());
            let mut answer = Redirect::to(&form.to).into_response();
            answer.headers_mut().insert(header::SET_COOKIE, cookie?);
            Ok(answer)
        }
        Err(problem) => {
            let page = pages::login::page(&form.to, Some(&problem.sentence));
            Ok((problem.status, page).into_response())
        }
    }
}

async fn sign_out(State(app): State<Arc<App>>, headers: HeaderMap) -> Answer {
    app.access.sign_out(&headers);
    let mut answer = Redirect::to("/login").into_response();
    let cookie = session_cookie(&app, "", 0)?;
    answer.headers_mut().insert(header::SET_COOKIE, cookie);
    Ok(answer)
}

fn session_cookie(app: &App, value: &str, seconds: u64) -> Result<HeaderValue, Problem> {
    let name = access::COOKIE;
    let secure = if app.is_encrypted { "; Secure" } else { "" };
    let cookie =
        format!("{name}={value}; Path=/; HttpOnly; SameSite=Strict; Max-Age={seconds}{secure}");
    HeaderValue::from_str(&cookie).map_err(|error| Problem::broken(error.to_string()))
}
