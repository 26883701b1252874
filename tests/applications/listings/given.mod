MODULE given
  PERS tooldata tGun:=[TRUE,[[50,-30,250],[0.9437143641,0.1276794407,-0.1448781254,0.2685358228]],[12,[0,0,100],[1,0,0,0],0,0,0]];
  PERS wobjdata wPart:=[FALSE,TRUE,"",[[900,-400,120],[0.9380860126,0.0499192929,0.0096612762,-0.3426504879]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget p1:=[[461.921,1581.755,1001.355],[0.75767605,0.11931039,0.45452722,0.45287640],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  PERS robtarget p2:=[[740.739,1297.947,1080.942],[0.77806622,0.12875378,0.43476188,0.43476146],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  PROC main()
    pick p1,50;
    p2:=CRobT(\Tool:=tGun\WObj:=wPart);
    p2.trans.z:=p2.trans.z+100;
    MoveL p2,v100,fine,tGun\WObj:=wPart;
    MoveL p1,v100,fine,tGun\WObj:=wPart;
  ENDPROC
  PROC pick(robtarget p,num high)
    MoveL p,v100,fine,tGun\WObj:=wPart;
    IF high>0 MoveL Offs(p,0,0,high),v100,fine,tGun\WObj:=wPart;
  ENDPROC
ENDMODULE
