//! Pages: one HTML file that holds everything it shows.
//!
//! No script, nothing from the network (a content security policy says so), both
//! colour schemes, narrow screens and paper. The markup is well-formed XML too.

use askama::Template;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use crate::palette;
use crate::plot::Plot;
use crate::table::{Mark, Table};

/// Sections from which on a page has a table of contents.
const MIN_CONTENTS: usize = 4;

/// The first bytes of every PNG file (PNG Specification, 3rd edition, 5.2).
const PNG_SIGNATURE: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

/// A page under construction. Text is text: markup in it is shown, not followed.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    lead: String,
    sections: Vec<Section>,
}

impl Page {
    /// A page with a title and nothing else.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            lead: String::new(),
            sections: Vec::new(),
        }
    }

    /// The paragraph under the title: what this is, and what came out.
    pub fn lead(mut self, text: impl Into<String>) -> Self {
        self.lead = text.into();
        self
    }

    /// Adds a section. From four on, the page has a table of contents.
    pub fn section(mut self, section: Section) -> Self {
        self.sections.push(section);
        self
    }

    /// The page as one HTML document.
    pub fn to_html(&self) -> String {
        let html = PageTemplate {
            page: self,
            style: style(),
            has_contents: self.sections.len() >= MIN_CONTENTS,
        };
        // The templates call nothing that fails, and neither does writing to a string.
        html.render().expect("rendering into a string cannot fail")
    }
}

/// A heading and the blocks below it, in the order in which they are added.
#[derive(Clone, Debug)]
pub struct Section {
    title: String,
    blocks: Vec<Block>,
}

impl Section {
    /// A section without blocks.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            blocks: Vec::new(),
        }
    }

    /// Adds a paragraph.
    pub fn paragraph(self, text: impl Into<String>) -> Self {
        self.block(Block::Paragraph(text.into()))
    }

    /// Adds a table. Wide ones scroll sideways below a fixed first column.
    pub fn table(self, table: Table) -> Self {
        self.block(Block::Table(table))
    }

    /// Adds a figure of full width.
    pub fn figure(self, figure: Figure) -> Self {
        self.block(Block::Figure(Box::new(figure)))
    }

    /// Adds figures side by side, in as many columns as there is room for.
    pub fn figures(self, figures: impl IntoIterator<Item = Figure>) -> Self {
        self.block(Block::Figures(figures.into_iter().collect()))
    }

    /// Adds pictures side by side.
    pub fn images(self, images: impl IntoIterator<Item = Image>) -> Self {
        self.block(Block::Images(images.into_iter().collect()))
    }

    /// Adds pairs of a term and what it stands for: machine, settings.
    pub fn definitions<K: Into<String>, V: Into<String>>(
        self,
        pairs: impl IntoIterator<Item = (K, V)>,
    ) -> Self {
        let pairs = pairs.into_iter().map(|(k, v)| (k.into(), v.into()));
        self.block(Block::Definitions(pairs.collect()))
    }

    /// Adds text in a fixed-width font, such as the command to run again.
    pub fn code(self, text: impl Into<String>) -> Self {
        self.block(Block::Code(text.into()))
    }

    fn block(mut self, block: Block) -> Self {
        self.blocks.push(block);
        self
    }
}

/// A plot with a caption.
#[derive(Clone, Debug)]
pub struct Figure {
    plot: Plot,
    caption: String,
}

impl Figure {
    /// A figure without a caption.
    pub fn new(plot: Plot) -> Self {
        Self {
            plot,
            caption: String::new(),
        }
    }

    /// The text below the plot.
    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }
}

/// A picture and its caption.
#[derive(Clone, Debug)]
pub struct Image {
    data: String,
    caption: String,
    width: u32,
    height: u32,
}

impl Image {
    /// A picture from the bytes of a PNG file, which the page will hold.
    ///
    /// # Errors
    /// [`NotPng`] if the bytes do not begin as a PNG file does. The pixels are
    /// not decoded.
    pub fn png(bytes: &[u8], caption: impl Into<String>) -> Result<Self, NotPng> {
        let caption = caption.into();
        // Signature; length and name of the first chunk; its first two fields.
        let size = |at: usize| Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?));
        match (size(16), size(20)) {
            (Some(width), Some(height))
                if bytes.starts_with(&PNG_SIGNATURE) && bytes[12..16] == *b"IHDR" =>
            {
                Ok(Self {
                    data: STANDARD.encode(bytes),
                    caption,
                    width,
                    height,
                })
            }
            _ => Err(NotPng { caption }),
        }
    }
}

/// A picture that is not a PNG file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the picture {caption:?} does not begin as a PNG file, expected PNG")]
pub struct NotPng {
    /// The caption it was given.
    pub caption: String,
}

#[derive(Clone, Debug)]
enum Block {
    Paragraph(String),
    Table(Table),
    Figure(Box<Figure>),
    Figures(Vec<Figure>),
    Images(Vec<Image>),
    Definitions(Vec<(String, String)>),
    Code(String),
}

#[derive(Template)]
#[template(path = "page.html")]
struct PageTemplate<'a> {
    page: &'a Page,
    style: String,
    has_contents: bool,
}

/// The style sheet, with both sets of colours in front.
fn style() -> String {
    let (light, dark) = (palette::light_properties(), palette::dark_properties());
    let rules = include_str!("../templates/page.css");
    format!(
        ":root{{{light}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n{rules}"
    )
}
