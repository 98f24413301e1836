use super::*;

fn charts() -> Charts {
    Charts {
        x_label: "time, s".into(),
        x: vec![0.0, 0.04, 0.08],
        panels: vec![Panel {
            title: "tip error, mm".into(),
            series: vec![Series {
                label: "</script><b>".into(),
                colour: Colour::Blue,
                dotted: false,
                values: vec![Some(0.1), None, Some(0.2)],
            }],
            levels: vec![Level { label: "bound".into(), colour: Colour::Red, value: 0.6 }],
            at_least: [0.0, 0.5],
            at_most: [0.0, 4.0],
        }],
        band_kinds: vec![BandKind { label: "tracking".into(), colour: Colour::Green }],
        bands: vec![Band { from: 0.0, to: 0.12, kind: 0 }],
        moments: vec![Moment { at: 0.05, colour: Colour::Orange, label: "probe slips".into() }],
        pictures: Some(Pictures {
            size_px: [640, 480],
            shown_px: [120.0, 0.0, 400.0, 480.0],
            spacing_mm: Some(0.1),
            places: vec![0, 2],
            pictures: vec![Picture::from_jpeg(b"one"), Picture::from_jpeg(b"two")],
            spots: vec![Spot {
                label: "tip".into(),
                shape: Shape::Box { side_px: 20.0 },
                colour: None,
                hidden: false,
                at_px: vec![Some([1.0, 2.0]), None, Some([3.0, 4.0])],
            }],
            readings: vec![],
            plays_s: Some(1.0),
        }),
    }
}

fn page_of(block: Block) -> String {
    let sections = vec![Section::new("Part <one>", vec![block])];
    Page { title: "A & B".into(), sections, ..Page::default() }.html().unwrap()
}

#[test]
fn words_are_escaped_and_drawings_are_not() {
    let page = page_of(Block::Text("a < b".into()));
    assert!(page.contains("<title>A &amp; B</title>") && page.contains("<h2>Part &lt;one&gt;</h2>"));
    assert!(page.contains("<p>a &lt; b</p>"));
    let figure = Block::Figure { svg: "<svg id=\"d\"></svg>".into(), caption: "x > y".into() };
    let page = page_of(figure);
    assert!(page.contains("<svg id=\"d\"></svg><figcaption>x &gt; y</figcaption>"));
}

#[test]
fn a_table_has_marks_only_where_a_row_has_one() {
    let columns = vec![Column::text("what"), Column::number("value")];
    let plain = Table { columns: columns.clone(), rows: vec![Row::new(["a", "1"])] };
    let page = page_of(Block::Table(plain));
    assert!(page.contains("<thead><tr><th>what</th><th class=\"number\">value</th></tr></thead>"));
    assert!(page.contains("<tr><td>a</td><td class=\"number\">1</td></tr>"));
    let rows = vec![Row::new(["a", "1"]).marked(Mark::Fail).leading_to(2.5), Row::new(["b", "2"])];
    let page = page_of(Block::Table(Table { columns, rows }));
    assert!(
        page.contains("<tr class=\"fail\" data-at=\"2.5\" tabindex=\"0\"><td><span class=\"mark fail\">✗")
    );
    assert!(page.contains("<tr><td></td><td>b</td>"));
}

#[test]
fn data_of_charts_cannot_end_their_script_and_come_back_as_they_were() {
    let page = page_of(Block::Charts(Box::new(charts())));
    let data =
        page.split("<script type=\"application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
    let data: serde_json::Value = serde_json::from_str(data).unwrap();
    assert_eq!(data["panels"][0]["series"][0]["label"], "</script><b>");
    assert_eq!(data["panels"][0]["series"][0]["values"], serde_json::json!([0.1, null, 0.2]));
    assert_eq!(data["pictures"]["spots"][0]["shape"], "box");
    assert_eq!(data["pictures"]["pictures"][1], "dHdv");
}

#[test]
fn nothing_is_asked_of_the_network() {
    let strip = Block::Strip(vec![StripPicture {
        picture: Picture::from_jpeg(b"one"),
        size_px: [640, 480],
        shown_px: [120.0, 0.0, 400.0, 480.0],
        marks: vec![
            (Shape::Box { side_px: 20.0 }, Colour::Green, [30.0, 40.0]),
            (Shape::Cross, Colour::Red, [1.0, 2.0]),
        ],
        caption: "start".into(),
    }]);
    let page = page_of(strip);
    assert!(page.contains("viewBox=\"120.0 0.0 400.0 480.0\"") && page.contains("x=\"20.0\" y=\"30.0\""));
    assert!(page.contains("href=\"data:image/jpeg;base64,b25l\""));
    for page in [page, page_of(Block::Charts(Box::new(charts())))] {
        for outside in [
            "src=\"http",
            "href=\"http",
            "<link rel=\"stylesheet",
            "<script src",
            "url(",
            "@import",
            "fetch(",
        ] {
            assert!(!page.contains(outside), "{outside}");
        }
    }
    // A page without charts carries no code to draw them.
    assert!(page_of(Block::Text("a".into())).len() < 40_000);
}
